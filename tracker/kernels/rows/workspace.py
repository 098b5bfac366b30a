"""Length of the rows of a workspace that hold numbers of one kind each, as native/contours/workspace.hpp has it."""

ROW = 33 * 32
"""Room for crossings or samples of one part."""
