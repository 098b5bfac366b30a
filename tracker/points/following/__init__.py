"""Following points through a sequence by least squares matching (D'Apuzzo et al. 2000, section 2.3)."""
