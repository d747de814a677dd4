"""Analyse ratings: mean opinion scores, the participants' bias and inconsistency, and one scale with pair votes."""
