"""One trial: how its films are played, what its viewer did, and whether its vote is valid."""
