"""Studies by the command line: what it prints, and how it ends, above all when the input is bad."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from sqlalchemy import update

from app.cli.studies import _balance_lines
from app.operations.database import open_store
from app.settings import Settings
from app.store.database.tables import assignment
from recon.runtime.files import read_json, write_json
from tests.app import tiny_stimuli
from tests.command_line import Command


def test_a_set_of_one_condition_says_what_a_study_needs(command: Command, stimuli: Path, tmp_path: Path) -> None:
    (tmp_path / "one" / "ball").mkdir(parents=True)
    shutil.copy(stimuli / "ball" / "id_fa.mp4", tmp_path / "one" / "ball" / "a.mp4")
    told = command("stimuli", "import", tmp_path / "one", "-o", tmp_path / "my set")
    assert f"OTHER_SET '{tmp_path / 'my set'}' -o SET" in told.out, "the command can be copied"
    assert "1 video: 1 condition of 1 dataset" in told.out
    assert "A study compares two or more conditions of each dataset, and ball has one." in told.out
    missing = command("study", "create", stimuli, "--name", "X", "--options", tmp_path / "nothing.toml")
    assert f"{tmp_path / 'nothing.toml'}: there is no such file; expected a TOML file" in missing.err
    assert "Errno" not in missing.err
    folder = command("study", "create", stimuli, "--name", "X", "--options", tmp_path)
    assert f"{tmp_path}: is a folder; expected a TOML file" in folder.err


@pytest.mark.slow
def test_a_study_is_created_and_listed(command: Command, stimuli: Path) -> None:
    created = command("study", "create", stimuli, "--name", "Tiny", "--seed", 1, "--json")
    assert created.code == 0, created.err
    assert json.loads(created.out)["n_pairs"] == 1
    listed = command("study", "list")
    assert "tiny (open): nobody has begun" in listed.out
    again = command("study", "create", stimuli, "--name", "Again")
    assert "Created the study again: 1 pair of 2 conditions" in again.out


@pytest.mark.slow
def test_a_study_starts_from_a_preset_and_the_command_overrides_it(command: Command, stimuli: Path) -> None:
    created = command("study", "create", stimuli, "--name", "Home", "--preset", "online", "--break-every", 7)
    assert created.code == 0, created.err
    told = json.loads(command("study", "export", "home", "--json").out)["toml"]
    for line in ('distance = "blind spot"', "identical_pairs = 1", "break_every = 7", 'name = "experience"'):
        assert line in told


OPTIONS = """optional_stages = ["practice"]
both_orders = true
identical_pairs = 1
"""


@pytest.mark.slow
def test_a_studys_options_come_from_a_file_and_from_the_command(
    command: Command, stimuli: Path, tmp_path: Path
) -> None:
    (tmp_path / "options.toml").write_text(OPTIONS)
    created = command(
        "study", "create", stimuli, "--name", "Tiny", "--options", tmp_path / "options.toml", "--identical-pairs", 2
    )
    assert created.code == 0, created.err
    exported = command("study", "export", "tiny", "--json")
    told = json.loads(exported.out)["toml"]
    assert 'optional_stages = ["practice"]' in told
    assert "both_orders = true\nidentical_pairs = 2\n" in told


@pytest.mark.slow
def test_a_dataset_for_practice_is_left_out_of_the_trials_and_comes_back_with_the_study_file(
    command: Command, tmp_path: Path
) -> None:
    stimuli = tiny_stimuli.write_set(tmp_path / "set", ("ball", "box"), tiny_stimuli.APPROACHES).parent
    (tmp_path / "options.toml").write_text('optional_stages = ["practice"]')
    lent = command("study", "create", stimuli, "--name", "Lent", "--options", tmp_path / "options.toml")
    assert "The practice shows ball/id_fa and ball/pm_fb, and the trials compare these two films, too" in lent.out
    spared = command("study", "create", stimuli, "--name", "Spared", "--practice", "box", "--json")
    assert spared.code == 0, spared.err
    told = json.loads(spared.out)
    assert (told["n_datasets"], told["n_pairs"], "notes" in told) == (1, 3, False)
    exported = json.loads(command("study", "export", "spared", "--json").out)["toml"]
    assert 'practice_pairs = [{ dataset = "box", a = "id_fa", b = "pm_fb" }]' in exported
    (tmp_path / "again.toml").write_text(exported.replace('"Spared"', '"Again"'))
    assert command("study", "import", tmp_path / "again.toml", "--stimuli", stimuli).code == 0
    again = json.loads(command("study", "export", "again", "--json").out)["toml"]
    assert again == exported.replace('"Spared"', '"Again"')


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("breaks = 3", "option 'breaks' is not known"),
        ("both_orders = 'yes'", "both_orders is 'yes'"),
        ("\xb0", "is no text in UTF-8; expected a TOML file"),
    ],
)
def test_options_that_are_not_right_are_named_with_their_file(
    command: Command, stimuli: Path, tmp_path: Path, options: str, complaint: str
) -> None:
    (tmp_path / "options.toml").write_text(options, encoding="latin-1")
    told = command("study", "create", stimuli, "--name", "Tiny", "--options", tmp_path / "options.toml")
    assert told.code == 1
    assert f"{tmp_path / 'options.toml'}: " in told.err
    assert complaint in told.err


@pytest.mark.parametrize("exposure", ["nan", "-3", "inf"])
def test_a_plan_is_made_for_films_of_a_possible_length_only(command: Command, exposure: str) -> None:
    told = command("plan", "--conditions", 2, "--datasets", 1, "--participants", 9, "--exposure", exposure)
    assert told.code == 2
    assert "expected a number from 0.1 to 3600" in " ".join(told.err.replace("│", " ").split())


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--effect", "-1", "'--effect': '-1', expected a number from 0.001 to 10"),
        ("--inconsistency", "nan", "'--inconsistency': 'nan', expected a number from 0.01 to 10"),
        ("--replicates", "1000000", "Invalid value for '--replicates'"),
    ],
)
def test_a_plan_of_impossible_numbers_is_refused_by_its_options(
    command: Command, option: str, value: str, expected: str
) -> None:
    sizes = ("--conditions", 2, "--datasets", 1, "--participants", 9)
    told = command("plan", *sizes, option, value)
    assert told.code == 2
    assert expected in " ".join(told.err.replace("│", " ").split())


def test_a_plan_tells_how_far_its_simulation_is(command: Command) -> None:
    told = command("plan", "--conditions", 2, "--datasets", 1, "--participants", 30, "--replicates", 10, "--json")
    assert json.loads(told.out)["replicates"] == 10
    assert "studies of one dataset simulated: 110/110" in told.err
    assert "studies of all datasets simulated: 110/110" in told.err


@pytest.mark.slow
def test_films_are_rated_where_the_protocol_says_so_and_planned_in_grades(command: Command, stimuli: Path) -> None:
    refused = command("study", "create", stimuli, "--name", "Rated", "--protocol", "DCR")
    assert refused.code == 1
    assert "protocol DCR needs a reference" in refused.err
    created = command("study", "create", stimuli, "--name", "Rated", "--protocol", "ACR", "--scale", "slider")
    assert "2 trials of 2 conditions" in created.out
    told = json.loads(command("study", "export", "rated", "--json").out)["toml"]
    assert 'protocol = "ACR"\nscale = "slider"\n' in told
    sizes = ("--conditions", 2, "--datasets", 1, "--participants", 20, "--exposure", 11)
    plan = json.loads(command("plan", *sizes, "--protocol", "ACR", "--json").out)
    assert (plan["trials"], plan["minutes"], plan["votes"]) == (2, 1, 40)
    assert "grades" in command("plan", *sizes, "--protocol", "DCR").out
    assert "1 trial for each of 20 participants: about 1 minute." in command("plan", *sizes).out
    refused = command("plan", *sizes, "--protocol", "MOS")
    assert refused.code == 2
    assert "'MOS', expected one of PC" in refused.err


@pytest.mark.slow
def test_an_exported_study_is_imported_beside_the_same_stimuli_only(
    command: Command, stimuli: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 5, "--both-orders", "--break-every", 0)
    file = tmp_path / "tiny.toml"
    assert command("study", "export", "tiny", "-o", file).code == 0
    first = file.read_text()
    assert command("study", "export", "tiny", "-o", tmp_path / "folder to make/tiny.toml").code == 0
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path / "elsewhere"))
    assert "names no stimuli" in command("study", "import", file).err
    imported = command("study", "import", file, "--stimuli", stimuli, "--json")
    assert imported.code == 0, imported.err
    assert json.loads(imported.out)["seed"] == 5
    assert json.loads(command("study", "export", "tiny", "--json").out)["toml"] == first

    manifest = read_json(stimuli / "manifest.json")
    write_json(stimuli / "manifest.json", manifest | {"name": "another"})
    file.write_text(f'stimuli = "{stimuli.name}"\n' + first.replace('"Tiny"', '"Other"'))
    told = command("study", "import", file)
    assert told.code == 1
    assert "this is another stimulus set" in told.err


@pytest.mark.parametrize("url", ["https://study.example.org", "https://study.example.org/"])
def test_a_link_leads_to_the_address_that_is_given_with_or_without_a_slash_at_its_end(
    command: Command, url: str
) -> None:
    added = json.loads(command("admin", "add", "Me", "--url", url, "--json").out)
    assert added["link"] == f"https://study.example.org{added['path']}"


def test_a_link_says_that_a_server_must_run_where_none_does(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    said = " once `reconstudy serve` runs"
    told = command("admin", "add", "Me").out
    assert "Me signs in, once and within a day, with http" in told
    assert said in told
    monkeypatch.setattr("app.operations.running.running_url", lambda _: "http://127.0.0.1:8000")
    assert said not in command("admin", "add", "Me").out


@pytest.mark.parametrize("key", ['name = "Tiny"', "exposure_s = 1.5", "[options]"])
def test_a_study_file_in_place_of_its_options_is_named(command: Command, tmp_path: Path, key: str) -> None:
    path = tmp_path / "tiny.toml"
    path.write_text(key, encoding="utf-8")
    told = command("study", "create", tmp_path, "--name", "Tiny", "--options", path)
    assert told.code == 1
    assert "tiny.toml: is a study file; make its study by `reconstudy study import FILE" in told.err


@pytest.mark.slow
def test_an_invitation_is_made_for_so_many(command: Command, stimuli: Path) -> None:
    told = command("study", "create", stimuli, "--name", "Tiny").out
    assert "Participants read it in English, Deutsch" in told
    made = json.loads(command("study", "invite", "tiny", "--places", 3, "--json").out)
    assert made["link"].endswith(f"/s/{made['invitation']}")
    assert made["invitation"] in command("study", "list").out
    assert "there is no study 'none'" in command("study", "invite", "none").err


def test_a_rule_of_who_finished_is_not_broken_but_not_reached_yet() -> None:
    rules = [
        {"rule": "spread", "of": of, "worst": 2, "allowed": 1, "ok": False}
        for of in ("who hold a slot", "who finished")
    ]
    report = {"seed": 1, "ok": False, "participants": {"finished": 2}, "rules": rules}
    assert [line.split()[0] for line in list(_balance_lines(report))[-2:]] == ["NO", "not"]


def test_nothing_is_said_to_be_balanced_before_anybody_has_begun() -> None:
    rules = [{"rule": "spread", "of": "each", "worst": 0, "allowed": 1, "ok": True}]
    first, *_, last = _balance_lines({"seed": 1, "ok": True, "participants": {"finished": 0}, "rules": rules})
    assert first == "Orders from the seed 1: nobody has begun"
    assert last.startswith("  not yet")


@pytest.mark.slow
def test_balance_is_told(command: Command, stimuli: Path) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 1)
    assert command("simulate", "--study", "tiny", "--participants", 3).code == 0
    told = command("study", "balance", "tiny")
    assert "Orders from the seed 1: balanced" in told.out
    assert "3 finished" in told.out
    assert told.code == 0
    report = json.loads(command("study", "balance", "tiny", "--json").out)
    assert report["pairs"][0]["n_shown"] == 3
    with open_store(Settings()) as database, database.writing() as connection:
        connection.execute(update(assignment).values(first_shown="a"))
    changed = command("study", "balance", "tiny")
    assert "Orders from the seed 1: NOT BALANCED" in changed.out
    assert changed.code == 1, "a script notices, as of db check"
