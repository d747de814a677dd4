"""Fit the models: counts, Newton, ties, existence, Bradley-Terry, Thurstone, bootstrap, random effects, contrasts."""
