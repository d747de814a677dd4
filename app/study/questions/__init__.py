"""The questions that participants answer beside their votes."""
