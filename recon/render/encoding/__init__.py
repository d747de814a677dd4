"""Encode frames as a film, and check every frame of it."""
