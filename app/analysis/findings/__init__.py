"""Say in sentences what an analysis shows and what it leaves open; every sentence follows from its numbers."""
