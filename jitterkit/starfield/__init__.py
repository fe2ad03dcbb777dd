"""Blur of a field of stars: one kernel for all of them, and whether it is tracking or optics."""
