"""Acquisition: the body model of a person from silhouettes and edges (Gavrila & Davis 1996, section 3)."""
