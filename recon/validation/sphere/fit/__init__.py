"""Fit a sphere of known radius: consensus, refinement, and whether the result is plausible."""
