"""Run the command line as `python -m app.cli`, as workers do for jobs."""

from app.cli import main

main()
