"""Who takes part in a study: invitations, records of participants, their votes, comments and interviews."""
