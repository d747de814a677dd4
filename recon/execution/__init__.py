"""Where work runs: workers of our own, programs of others."""
