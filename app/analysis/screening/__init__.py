"""Judge people and votes: circular triads, chance, observers, attention checks, agreement."""
