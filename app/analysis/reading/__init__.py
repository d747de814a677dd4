"""Read any table of votes or of measures: recognise its layout, then read it."""
