"""Gaussian splats of every common form, read and cleaned: `read` chooses by the file, and `raw` finds what is wrong."""
