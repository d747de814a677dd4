"""What both halves, `app` and `recon`, stand on; it imports neither, and nothing heavy."""
