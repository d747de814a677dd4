"""Limits on what one client may ask: how often, how much, and over how many connections."""
