"""What every step runs on: files local or remote, artefacts made once, worker processes, programs of others."""
