"""Names of the columns of packed rows, one file for each kind of row; plain integers cost compiled code nothing."""
