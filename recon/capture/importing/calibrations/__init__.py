"""Calibrations as programs, toolboxes and data sets write them: each file's cameras, as views to choose from."""
