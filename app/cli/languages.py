"""The commands on language packs."""

from __future__ import annotations

import typer

from app.cli.shared import server_settings
from app.operations.commands.studies import LanguagesCheck
from recon.cli.console import JsonOption, print_result
from recon.cli.flags import with_settings

app = typer.Typer()
languages_app = typer.Typer(
    invoke_without_command=True, help="List the languages of the participants' pages, or check a language pack."
)
app.add_typer(languages_app, name="languages")


@languages_app.callback()
def languages_list(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the languages of the participants' pages, or check a language pack."""
    if context.invoked_subcommand is not None:
        return
    from app.operations.studies.languages import find_language_packs

    settings = server_settings()
    files = find_language_packs(settings)
    used = {file.pack.tag: file.path for file in files if file.pack is not None}
    rows = [
        {
            "tag": file.path.stem,
            "name": file.pack.name if file.pack else None,
            "direction": file.pack.direction if file.pack else None,
            "status": file.pack.status if file.pack else "refused",
            "in_use": used.get(file.path.stem) == file.path,
            "path": str(file.path),
            "refusal": file.refusal or None,
        }
        for file in files
    ]
    lines = [
        f"refused: {row['refusal']}"
        if row["refusal"]
        else f"{row['tag']}: {row['name']} ({row['direction']}, {row['status']}), {row['path']}"
        + ("" if row["in_use"] else "; replaced by a pack in the data folder")
        for row in rows
    ]
    result = {"languages": rows, "folder": str(settings.languages_dir)}
    print_result(result, "\n".join([*lines, f"Your own packs go into {settings.languages_dir}"]), as_json=as_json)


@languages_app.command("check")
@with_settings(LanguagesCheck)
def languages_check(asked: LanguagesCheck, *, as_json: bool) -> None:
    """Check language packs: missing and unknown keys, placeholders, empty texts, plurals, HTML."""
    from app.study.languages.language_pack import language_pack_faults

    faults = {str(file): language_pack_faults(file) for file in asked.files}
    lines = [f"{file}: {fault}" for file, listed in faults.items() for fault in listed]
    lines += [f"{file}: complete" for file, listed in faults.items() if not listed]
    print_result({"faults": faults, "ok": not any(faults.values())}, "\n".join(lines), as_json=as_json)
    if any(faults.values()):
        raise typer.Exit(1)
