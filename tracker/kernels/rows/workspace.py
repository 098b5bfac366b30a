"""Length of the rows of a workspace that hold numbers of one kind each."""

BLOCK = 32
"""So many numbers of a row the compiled code handles at a time; a power of 2."""

ROW = 33 * BLOCK
"""Room for crossings or samples of one part. Numbers of one kind stand in rows of this length of one flat array: only
so does the compiler see that they are apart, and computes eight at a time. Whole blocks, or the last one would be
written beyond the array; not a multiple of 1024, or all rows would share their cache lines."""
