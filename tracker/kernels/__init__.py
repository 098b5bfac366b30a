"""Compiled inner loops; each has a plain twin that the tests hold it against."""
