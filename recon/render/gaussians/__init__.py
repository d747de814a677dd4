"""Gaussian splats to pixels without a GPU: where they fall, in which tiles, and how they cover each other."""
