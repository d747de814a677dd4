"""Read files of every format that tables come in."""
