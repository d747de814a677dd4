"""Which pairs or stimuli somebody sees, and in which order."""
