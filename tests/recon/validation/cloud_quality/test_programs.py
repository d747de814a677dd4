"""Measures by programs of others, declared in a methods file."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from recon.runtime.programs import ProgramError
from recon.validation.cloud_quality.programs import MeasureProgram, program_measures
from tests.command_line import Command
from tests.recon.validation.cloud_quality.clouds import ball, table, validate, write

PROGRAM = """
import sys
sys.path.insert(0, {root!r})
from pathlib import Path
from recon.geometry.mesh_files import read_cloud
reference, distorted = (read_cloud(Path(name)) for name in sys.argv[1:3])
print("1 warning: this is not what was asked for")
print("value is :", len(distorted) / len(reference))
print("0.125 s elapsed")
"""


@pytest.fixture
def methods(tmp_path: Path) -> Path:
    """A methods file with a program that prints the share of points that are left, then how long it took."""
    root = str(Path(__file__).parents[4])
    (tmp_path / "share.py").write_text(PROGRAM.format(root=root))
    file = tmp_path / "methods.toml"
    file.write_text(
        f"[measure.share]\ncommand = '{sys.executable} {{folder}}/share.py {{reference}} {{distorted}}'\n"
        "pattern = 'value is : (\\S+)'\nbetter = 'higher'\nunit = 'share'\n\n"
        "[depth.dr-sigma8]\nmethod = 'dr'\nsigma = 8\n"
    )
    return file


@pytest.mark.slow
def test_a_program_measures_every_pair_and_stands_beside_ours(command: Command, methods: Path, tmp_path: Path) -> None:
    reference = write(tmp_path / "reference.ply", ball(100))
    clouds = [write(tmp_path / f"{name}.ply", ball(n)) for name, n in (("half", 50), ("tenth", 10))]
    out = tmp_path / "report"
    options = ("--methods", methods, "--measures", "share,chamfer")
    report = validate(command, out, *clouds, "--reference", reference, *options)
    rows = {(row["approach"], row["measure"]): row for row in table(out)}
    assert float(rows["half", "share"]["value"]) == 0.5
    assert float(rows["tenth", "share"]["value"]) == 0.1
    assert "share.py {reference} {distorted}" in rows["half", "share"]["source"]
    assert {measure for _, measure in rows} == {"share", "chamfer"}
    assert [row["value"] for row in report["measures"] if row["measure"] == "share"] == [0.5, 0.1]
    assert [path.name for path in (out / "programs" / "share" / "half").iterdir()] == ["log.txt"]


def test_a_program_that_fails_is_named_with_its_log_and_the_rest_is_measured(command: Command, tmp_path: Path) -> None:
    methods = tmp_path / "methods.toml"
    methods.write_text("[measure.pcqm]\ncommand = 'no-such-PCQM {reference} {distorted}'\nbetter = 'lower'\n")
    cloud = write(tmp_path / "a.ply", ball(100))
    report = validate(command, tmp_path / "report", cloud, "--reference", cloud, "--methods", methods)
    assert [row["measure"] for row in report["skipped"]] == ["pcqm"]
    assert re.search(r"no-such-PCQM could not be started.*its log is .*log.txt", report["skipped"][0]["reason"])
    assert any(row["measure"] == "d1_mse" for row in report["values"])


@pytest.mark.slow
def test_approaches_whose_names_differ_in_a_space_have_folders_of_their_own(command: Command, tmp_path: Path) -> None:
    methods = tmp_path / "methods.toml"
    methods.write_text("[measure.pcqm]\ncommand = 'no-such-PCQM {reference} {distorted}'\nbetter = 'lower'\n")
    clouds = [write(tmp_path / f"{name}.ply", ball(100)) for name in ("a b", "a_b")]
    options = ("--methods", methods, "--measures", "pcqm,d1")
    report = validate(command, tmp_path / "report", *clouds, "--reference", clouds[0], *options)
    logs = [Path(row["reason"].partition("its log is ")[2]) for row in report["skipped"]]
    assert len({log for log in logs if log.is_file()}) == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("better = 'lower'", "command is missing"),
        ("command = 'p {reference} {distorted}'", "better is '', expected one of lower, higher"),
        ("command = 'p {reference}'\nbetter = 'lower'", "lacks {distorted}"),
        ("command = 'p {reference} {distorted}'\nbetter = 'lower'\npattern = 'a'", "with 0 groups, expected one"),
        ("command = 'p {reference} {distorted}'\nbetter = 'lower'\npattern = '('", "no regular expression"),
        ("command = 'p {reference} {distorted}'\nbetter = 'lower'\nbest = 0", "best is unknown, expected one of comm"),
    ],
)
def test_a_table_that_cannot_be_used_is_named(tmp_path: Path, content: str, message: str) -> None:
    methods = tmp_path / "methods.toml"
    methods.write_text(f"[measure.mine]\n{content}\n")
    with pytest.raises(ValueError, match=r"methods.toml: \[measure.mine\]") as raised:
        program_measures(methods, tmp_path)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("printed", "pattern", "value"),
    [
        ("PCQM value is : 0.00175045\n2.5 sec elpased", r"PCQM value is : (\S+)", 0.00175045),
        ("first 3, then -1.5e-3 dB", "", -1.5e-3),
        ("PSNR inf", r"PSNR (\S+)", float("inf")),
    ],
)
def test_the_value_is_what_the_pattern_holds_or_the_last_number(printed: str, pattern: str, value: float) -> None:
    program = MeasureProgram("p {reference} {distorted}", "text", pattern=pattern, better="lower")
    assert program.value(printed) == value


@pytest.mark.parametrize(
    ("printed", "pattern", "message"),
    [
        ("nothing", "", "nothing that is a number"),
        ("1 2 3", "value (.+)", r"nothing that matches 'value \(\.\+\)'"),
        ("value none", "value (.+)", "printed 'none', expected a number"),
        ("value nan", "value (.+)", "nan"),
    ],
)
def test_a_program_that_prints_no_value_says_so(printed: str, pattern: str, message: str) -> None:
    program = MeasureProgram("p {reference} {distorted}", "text", pattern=pattern, better="lower")
    with pytest.raises(ProgramError, match=message):
        program.value(printed)
