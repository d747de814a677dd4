"""What came of a study: scores from votes, measures and models beside them, and their uploads."""
