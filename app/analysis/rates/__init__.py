"""Scores against the size of models: which conditions are worth their bytes, and how methods compare at equal size."""
