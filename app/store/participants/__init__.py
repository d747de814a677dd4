"""Invitations, participants, what they were screened for, and what they say."""
