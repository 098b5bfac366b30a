"""Occluding contours of a posed body, found and compared with edges, for `synthesis`, `similarity` and `estimation`."""
