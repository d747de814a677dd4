"""What operators watch: health checks, counts for Prometheus, the log of requests."""
