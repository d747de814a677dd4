"""Designs, orders, sessions, trials and votes; what is read from and deleted with them."""
