"""The likelihood of votes and its maximum: counts, ties, Newton, existence, penalties, errors."""
