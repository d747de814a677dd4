"""The options of a study, as files and forms give them."""
