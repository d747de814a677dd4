"""Accounts, second factors and tokens."""
