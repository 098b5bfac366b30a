"""Least squares matching: surfaces measured from two or more images (D'Apuzzo, Plaenkers, Fua 2000)."""
