"""Studies, what is attached to them, and who changed what."""
