"""Films of reconstructions against the reference's film on the same path."""
