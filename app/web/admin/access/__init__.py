"""Who may use the dashboard: sign-in, accounts with passwords and second factors, roles; the server's settings."""
