"""Light and its effect: looks, highlights, shadows, and what a camera writes."""
