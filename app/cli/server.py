"""The commands that serve studies and look after the server."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

import typer

from app.cli.shared import LINKS, once_served, server_settings
from app.operations.commands.server import AdminAdd, AdminRemove, Backup, Restore, Serve, TokenAdd, TokenRevoke, Work
from recon.cli.console import JsonOption, ProgressLine, counted, print_result
from recon.cli.flags import with_settings

EVERY_NETWORK = ("0.0.0.0", "::")  # addresses to listen on, where no other computer finds anything

app = typer.Typer()
admin_app = typer.Typer(no_args_is_help=True, help="Manage experimenters.")
token_app = typer.Typer(no_args_is_help=True, help="Manage the tokens with which analysts fetch results.")
db_app = typer.Typer(no_args_is_help=True, help="Check and upgrade the database.")
app.add_typer(admin_app, name="admin")
app.add_typer(token_app, name="token")
app.add_typer(db_app, name="db")


@app.command()
@with_settings(Serve)
def serve(asked: Serve) -> None:
    """Serve all studies, and run the dashboard's jobs, until you press Ctrl-C."""
    from app.main import serve as serve_studies
    from app.operations.jobs.beside_server import ends_in_order
    from app.operations.running import noted
    from app.operations.studies.manage import list_studies, set_up_path

    settings = server_settings()

    def announce(listens_at: str) -> None:
        running.enter_context(noted(settings, listens_at))
        print(f"Serving {settings.data_dir.absolute()} at {listens_at} until you press Ctrl-C.", flush=True)
        if settings.log_format == "json":  # then a log keeps what is printed, and links open sessions
            return
        url = settings.public_url or listens_at
        if asked.host in EVERY_NETWORK and settings.public_url is None:
            print(
                f"  on other computers, with this one's name or address for {asked.host}; "
                "RECONSTUDY_PUBLIC_URL sets it",
                flush=True,
            )
        for study in list_studies(settings):
            for link in study["shared_links"] if study["state"] in ("open", "paused") else ():
                print(f"  participants of {study['name']}: {url}{link}", flush=True)
        print(f"  experimenters: {url}/admin (sign-in link by `reconstudy admin add NAME`)", flush=True)
        if path := set_up_path(settings):
            print(f"  set up the first experimenter, once: {url}{path}", flush=True)

    with ends_in_order(), ExitStack() as running:
        serve_studies(settings, asked.host, asked.port, workers=asked.workers, n_jobs=asked.jobs, on_start=announce)


@app.command()
def status(as_json: JsonOption = False) -> None:
    """Tell where the data lie, what they hold, whether the server runs and what is installed; nothing is changed."""
    from app.operations.status import server_status

    result = server_status(server_settings())
    lines = [f"{name + ':':<15} {text}" for name, text in _status_lines(result)]
    print_result(result, "\n".join(lines), as_json=as_json)


def _status_lines(status: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    database, studies, films, sets = (status[name] for name in ("database", "studies", "films", "stimulus_sets"))
    yield "Version", status["version"]
    yield "Data folder", f"{status['data_dir']}, {status['free_gb']:g} GB free (RECONSTUDY_DATA_DIR names another)"
    size = "" if database["megabytes"] is None else f", {database['megabytes']:g} MB"
    yield "Database", f"{database['kind']} {database['place']}{size}"
    yield "Tables", _tables_sentence(database)
    if studies is not None:
        held = f"{counted(studies['participants'], 'participant')}, {counted(studies['votes'], 'vote')}"
        yield "Studies", f"{studies['n']}, {studies['open']} of them open; {held}"
    yield "Films", f"{films['n']}, {films['megabytes']:g} MB, in {films['place']}"
    yield "Stimulus sets", f"{sets['n']} for the dashboard, in {sets['place']}"
    yield "Server", status["server"] or "does not run; `reconstudy serve` starts it"
    yield "Work", "; ".join(status["jobs"]) or "none at the moment"
    yield "Extras", ", ".join(f"{name}{'' if there else ' (missing)'}" for name, there in status["extras"].items())


def _tables_sentence(database: Mapping[str, Any]) -> str:
    if not database["answers"]:
        return "not known; the database does not answer"
    if database["version"] is None:
        return "none yet; the first command that needs them makes them"
    if database["version"] == database["newest"]:
        return f"version {database['version']}, the newest"
    if database["version"] > database["newest"]:
        return f"version {database['version']}, expected {database['newest']}; they need a newer version of reconstudy"
    return f"version {database['version']}, expected {database['newest']}; `reconstudy db upgrade` upgrades them"


@app.command()
@with_settings(Work)
def work(asked: Work) -> None:
    """Run the dashboard's jobs until you press Ctrl-C; also on another machine, with the same database and folders."""
    from app.operations.extras import has_extra, install_command
    from app.operations.jobs.worker import work as run_jobs

    settings = server_settings()
    print(f"Running the jobs of {settings.data_dir.absolute()} until you press Ctrl-C.", flush=True)
    if not has_extra("recon"):
        print(f"Only films are imported here; for the other jobs: {install_command('recon')}", flush=True)
    run_jobs(settings, asked.jobs, once=asked.once)


@admin_app.command("add")
@with_settings(AdminAdd, **LINKS)
def admin_add(asked: AdminAdd, *, as_json: bool) -> None:
    """Make a sign-in link for an experimenter, valid once, for a day; older link, password and sessions end."""
    from app.operations.running import url_for_links
    from app.operations.studies.manage import add_experimenter

    settings = server_settings()
    added = add_experimenter(settings, asked.name, asked.role, asked.study)
    added["link"] = (asked.url or url_for_links(settings)) + added["path"]
    ended = "\nTheir old password does not hold any more; they choose a new one." if added["password_ended"] else ""
    signs_in = f"{added['name']} signs in, once and within a day, with {added['link']}{once_served(settings)}"
    print_result(added, signs_in + ended, as_json=as_json)


@admin_app.command("list")
def admin_list(as_json: JsonOption = False) -> None:
    """List all experimenters with their roles."""
    from app.operations.studies.manage import list_experimenters

    people = list_experimenters(server_settings())
    lines = [f"{person['name']}: {person['role']}, {person['state']}, {_seen(person['studies'])}" for person in people]
    sentence = "\n".join(lines) or "There is nobody yet; `reconstudy admin add NAME` adds an experimenter."
    print_result({"experimenters": people}, sentence, as_json=as_json)


def _seen(studies: Sequence[str] | None) -> str:
    return "all studies" if studies is None else f"only {', '.join(studies) or 'no study'}"


@admin_app.command("remove")
@with_settings(AdminRemove)
def admin_remove(asked: AdminRemove, *, as_json: bool) -> None:
    """End an experimenter's access and tokens at once; the audit log stays, and `admin add` lets them in again."""
    from app.operations.studies.manage import remove_experimenter

    remove_experimenter(server_settings(), asked.name)
    print_result({"name": asked.name}, f"{asked.name} has no access any more.", as_json=as_json)


@token_app.command("list")
def token_list(as_json: JsonOption = False) -> None:
    """List all tokens, newest first; their secrets are not stored."""
    from app.operations.studies.manage import list_tokens

    tokens = list_tokens(server_settings())
    lines = [
        f"{token['name']}: {token['state']}, may {', '.join(token['scopes'])}, {_seen(token['studies'])}"
        for token in tokens
    ]
    sentence = "\n".join(lines) or "There is no token yet; `reconstudy token add NAME` makes one."
    print_result({"tokens": tokens}, sentence, as_json=as_json)


@token_app.command("revoke")
@with_settings(TokenRevoke)
def token_revoke(asked: TokenRevoke, *, as_json: bool) -> None:
    """Revoke a token: it opens nothing from now on."""
    from app.operations.studies.manage import end_token

    was_valid = end_token(server_settings(), asked.name)
    sentence = f"{asked.name} is revoked." if was_valid else f"{asked.name} was revoked before."
    print_result({"name": asked.name, "was_valid": was_valid}, sentence, as_json=as_json)


@token_app.command("add")
@with_settings(TokenAdd)
def token_add(asked: TokenAdd, *, as_json: bool) -> None:
    """Make a bearer token for fetching results over REST; it is shown only once."""
    from app.operations.studies.manage import add_token, only_study

    if asked.study and asked.all_studies:
        raise typer.BadParameter("--study and --all-studies exclude each other; leave one out")
    settings = server_settings()
    opened = None if asked.all_studies else asked.study or [only_study(settings)]
    added = add_token(settings, asked.name, asked.scope, opened, days=asked.days or None)
    ends = f"until {added['expires_at'][:10]}" if asked.days else "until it is revoked"
    sentences = (
        f"Token of {added['name']}, shown this once: {added['token']}",
        f"It grants {', '.join(added['scopes'])} of {'all studies' if opened is None else ', '.join(opened)} {ends}; "
        "--scope, --study, --all-studies and --days grant more or less.",
    )
    print_result(added, "\n".join(sentences), as_json=as_json)


@app.command()
@with_settings(Backup)
def backup(asked: Backup, *, as_json: bool) -> None:
    """Back up everything that is stored, as it is at one moment; the server may run meanwhile."""
    from app.operations.upkeep.backup import back_up

    with ProgressLine():
        result = back_up(server_settings(), asked.file, with_media=asked.media, encrypt_to=asked.encrypt_to or ())
    kept = f"{_held(result)} are in {asked.file}{', encrypted' * result['encrypted']}."
    print_result(result, kept, as_json=as_json)


@app.command()
@with_settings(Restore)
def restore(asked: Restore, *, as_json: bool) -> None:
    """Restore a backup, all of it or nothing; the server may run meanwhile."""
    from app.operations.upkeep.backup import restore as restore_backup

    with ProgressLine():
        result = restore_backup(server_settings(), asked.file, replace=asked.replace, identity=asked.identity)
    again, missing = counted(result["erased_again"], "erasure"), counted(result["missing_videos"], "video")
    sentences = [f"{_held(result)} are back."]
    sentences += [f"Applied again: {again} since then."] if result["erased_again"] else []
    sentences += [f"Missing here: {missing}; a backup with --media has them."] if result["missing_videos"] else []
    print_result(result, " ".join(sentences), as_json=as_json)


def _held(kept: Mapping[str, Any]) -> str:
    return f"{counted(sum(kept['tables'].values()), 'row')} and {counted(kept['videos'], 'video')}"


@db_app.command("check")
def db_check(as_json: JsonOption = False) -> None:
    """Check the database and the films, models and reports it names; exit with 1 if anything is wrong."""
    from app.operations.upkeep.backup import check

    with ProgressLine():
        result = check(server_settings())
    print_result(result, "\n".join(result["faults"]) or "Nothing is wrong.", as_json=as_json)
    if result["faults"]:
        raise typer.Exit(1)


@db_app.command("upgrade")
def db_upgrade(as_json: JsonOption = False) -> None:
    """Upgrade the database to the newest version."""
    from app.operations.studies.manage import upgrade_database

    result = upgrade_database(server_settings())
    print_result(result, f"The database is at version {result['version']}.", as_json=as_json)
