"""The commands that serve studies and look after the server."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.shared import DEFAULT_URL, UrlOption
from recon.cli.console import JsonOption, print_result

app = typer.Typer()
admin_app = typer.Typer(no_args_is_help=True, help="Manage experimenters.")
token_app = typer.Typer(no_args_is_help=True, help="Manage the tokens with which analysts fetch results.")
db_app = typer.Typer(no_args_is_help=True, help="Check and upgrade the database.")
app.add_typer(admin_app, name="admin")
app.add_typer(token_app, name="token")
app.add_typer(db_app, name="db")


@app.command()
def serve(
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 for every network.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any free one.")] = 8000,
    workers: Annotated[int, typer.Option(min=1, help="Server processes; more than one needs PostgreSQL.")] = 1,
) -> None:
    """Serve all studies until you press Ctrl-C."""
    from app.main import serve as serve_studies
    from app.operations.manage import list_studies, set_up_path
    from app.settings import Settings

    settings = Settings()

    def announce(url: str) -> None:
        print(f"Serving at {url} until you press Ctrl-C.", flush=True)
        for study in list_studies(settings):
            for code in study["invitations"]:
                print(f"  participants of {study['name']}: {url}/s/{code}", flush=True)
        print(f"  experimenters: {url}/admin (sign-in link by `reconstudy admin add NAME --url {url}`)", flush=True)
        if path := set_up_path(settings):
            print(f"  set up the first experimenter, once: {url}{path}", flush=True)

    serve_studies(settings, host, port, workers=workers, on_start=announce)


@admin_app.command("add")
def admin_add(
    experimenter: Annotated[str, typer.Argument(metavar="NAME", help="The experimenter's name.")],
    role: Annotated[
        str | None,
        typer.Option(help="viewer, experimenter or owner; default: unchanged, or owner for a new experimenter."),
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Make a sign-in link for an experimenter, valid for a week; their older link and password end."""
    from app.operations.manage import add_experimenter
    from app.settings import Settings
    from app.store.experimenters import ROLES

    if role is not None and role not in ROLES:
        raise typer.BadParameter(f"--role is {role!r}, expected one of {', '.join(ROLES)}")
    added = add_experimenter(Settings(), experimenter, next((known for known in ROLES if known == role), None))
    added["link"] = url + added["path"]
    ended = "\nTheir old password does not hold any more; they choose a new one." if added["password_ended"] else ""
    print_result(added, f"{added['name']} signs in with {added['link']}{ended}", as_json=as_json)


@token_app.command("add")
def token_add(
    token_name: Annotated[str, typer.Argument(metavar="NAME", help="Who or what the token is for.")],
    scope: Annotated[
        list[str] | None,
        typer.Option(help="What the token may do: read, personal or audit; may be repeated; default: all."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a bearer token for fetching results over REST; it is shown only once."""
    from app.operations.manage import add_token
    from app.settings import Settings
    from app.store.tokens import SCOPES

    if unknown := sorted(set(scope or ()) - SCOPES.keys()):
        raise typer.BadParameter(f"--scope is {unknown[0]!r}, expected some of {', '.join(SCOPES)}")
    added = add_token(Settings(), token_name, tuple(scope or SCOPES))
    print_result(added, f"Token of {added['name']}, shown this once: {added['token']}", as_json=as_json)


@app.command()
def backup(
    file: Annotated[Path, typer.Argument(help="ZIP file to write.")],
    media: Annotated[
        bool, typer.Option("--media", help="Include the pair videos, attached reports and models.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Back up everything that is stored, as it is at one moment; the server may run meanwhile."""
    from app.operations.backup import back_up
    from app.settings import Settings

    result = back_up(Settings(), file, with_media=media)
    n_rows = sum(result["tables"].values())
    print_result(result, f"{n_rows} rows and {result['videos']} videos are in {file}.", as_json=as_json)


@app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="ZIP file that `reconstudy backup` wrote, from SQLite or PostgreSQL.")],
    replace: Annotated[
        bool,
        typer.Option("--replace", help="First delete what the database holds: studies, people, tokens, the audit log."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Restore a backup, all of it or nothing; the server may run meanwhile."""
    from app.operations.backup import restore as restore_backup
    from app.settings import Settings

    result = restore_backup(Settings(), file, replace=replace)
    print_result(
        result, f"{sum(result['tables'].values())} rows and {result['videos']} videos are back.", as_json=as_json
    )


@db_app.command("check")
def db_check(as_json: JsonOption = False) -> None:
    """Check the database and the films, models and reports it names; exit with 1 if anything is wrong."""
    from app.operations.backup import check
    from app.settings import Settings

    result = check(Settings())
    print_result(result, "\n".join(result["faults"]) or "Nothing is wrong.", as_json=as_json)
    if result["faults"]:
        raise typer.Exit(1)


@db_app.command("upgrade")
def db_upgrade(as_json: JsonOption = False) -> None:
    """Upgrade the database to the newest version."""
    from app.operations.manage import upgrade_database
    from app.settings import Settings

    result = upgrade_database(Settings())
    print_result(result, f"The database is at version {result['version']}.", as_json=as_json)
