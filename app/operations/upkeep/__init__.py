"""What keeps a server whole: backups, encryption, erasure, what to clear away."""
