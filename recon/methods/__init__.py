"""The methods that a run can use: their names, the file that sets them, packages that bring more."""
