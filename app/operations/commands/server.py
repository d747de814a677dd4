"""The settings of the commands that serve studies and look after the server."""

from __future__ import annotations

from pathlib import Path

from app.operations.commands.studies import URL
from app.store.access.rights import LONGEST_TOKEN_DAYS, READ, SCOPES, Role, Scope
from recon.cli.commands.setting import Command, argument, option


class Serve(Command):
    """Of `serve`."""

    host: str = option("127.0.0.1", "Address to listen on; 0.0.0.0 for every network.")
    port: int = option(8000, "Port; 0 for any free one.", ge=0, le=65535)
    workers: int = option(1, "Server processes; more than one needs PostgreSQL.", ge=1)
    jobs: int = option(1, "How many of the dashboard's jobs to run at a time; 0: leave them to other workers.", ge=0)


class Work(Command):
    """Of `work`."""

    jobs: int = option(1, "How many jobs to run at a time.", ge=1)
    once: bool = option(False, "End when no job waits any more.", flags=("--once",))


class AdminAdd(Command):
    """Of `admin add`."""

    name: str = argument("The experimenter's name.")
    role: Role | None = option(None, "What they may do; default: unchanged, or owner for a new experimenter.")
    study: list[str] | None = option(
        None, "Short name of a study to see, once for each, or '*' for all; default: unchanged, or all."
    )
    url: str | None = URL


class AdminRemove(Command):
    """Of `admin remove`."""

    name: str = argument("The experimenter's name.")


class TokenAdd(Command):
    """Of `token add`."""

    name: str = argument("Who or what the token is for.")
    scope: list[Scope] = option([READ], f"What the token may do, once for each: {', '.join(SCOPES)}.")
    study: list[str] | None = option(
        None, "Short name of a study that it opens, once for each; default: the only study."
    )
    all_studies: bool = option(False, "Open all studies, also those that are made later.", flags=("--all-studies",))
    days: int = option(365, "Days until it ends; 0: only when it is revoked.", ge=0, le=LONGEST_TOKEN_DAYS)


class TokenRevoke(Command):
    """Of `token revoke`."""

    name: str = argument("The token's name, as `token list` shows it.")


class Backup(Command):
    """Of `backup`."""

    file: Path = argument("ZIP file to write; an earlier backup of this name is replaced.", metavar="FILE")
    media: bool = option(False, "Include the pair videos, attached reports and models.", flags=("--media",))
    encrypt_to: list[str] | None = option(
        None, "Public key (age1…, ssh-ed25519 …) or file of such keys, whose owners alone can read the backup."
    )


class Restore(Command):
    """Of `restore`."""

    file: Path = argument("ZIP file that `reconstudy backup` wrote, from SQLite or PostgreSQL.", metavar="FILE")
    replace: bool = option(
        False, "First delete what the database holds: studies, people, tokens, the audit log.", flags=("--replace",)
    )
    identity: Path | None = option(None, "File of the private key to an encrypted backup.")
