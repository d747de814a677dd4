"""The people of the studio: bones, bodies, clothes, and the layout of their texture."""
