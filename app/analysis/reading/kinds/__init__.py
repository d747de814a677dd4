"""Find one kind of votes or ratings each, in what a table shows and what was told."""
