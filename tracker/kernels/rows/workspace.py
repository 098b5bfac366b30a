"""Length of the rows of a workspace that hold numbers of one kind each."""

ROW = 1040
"""Room for crossings or samples of one part. Numbers of one kind stand in rows of this length of one flat array: only
so does the compiler see that they are apart, and computes eight at a time. Not a multiple of 1024, or all rows would
share their cache lines."""
