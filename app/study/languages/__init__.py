"""The texts of a study in each language."""
