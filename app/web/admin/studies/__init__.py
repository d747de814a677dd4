"""Studies: create and list them, edit their settings and texts, check their design, watch them; stimulus sets."""
