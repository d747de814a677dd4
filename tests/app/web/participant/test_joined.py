"""The participant's scripts and styles come as one file each, for good."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.files import packaged
from app.web.participant import joined
from app.web.participant.joined import FOR_GOOD, SCRIPT, STYLES, joined_address, joined_modules

A_PAGE = {
    "page.js": 'import { two } from "./two.js";\nimport { one } from "./one.js";\nconsole.log(one(), two(), await 3)\n',
    "two.js": 'import { one } from "./one.js";\n\n/** Twice. */\n'
    "export function two() {\n  return 2 * one() * more;\n}\nconst more = 1;\n",
    "one.js": "let n = 0;\nconst more = 5; // of its own\nexport const one = () => more + n++;\n",
}


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "static" / "js"
    folder.mkdir(parents=True)
    for name, source in A_PAGE.items():
        (folder / name).write_text(source)
    monkeypatch.setattr(joined, "packaged", lambda name: tmp_path / name)
    return folder


def run(script: str, tmp_path: Path) -> str:
    (tmp_path / "joined.mjs").write_text(script)
    return subprocess.run(
        ["node", "joined.mjs"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    ).stdout.strip()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("node") is None, reason="node runs the scripts, and is not installed")
def test_joined_modules_do_what_they_do_apart(page: Path, tmp_path: Path) -> None:
    apart = subprocess.run(
        ["node", "--experimental-default-type=module", "page.js"], cwd=page, capture_output=True, text=True, check=True
    ).stdout.strip()
    assert run(joined_modules("page.js"), tmp_path) == apart == "5 12 3"


@pytest.mark.parametrize(
    ("source", "refusal"),
    [
        ('import * as one from "./one.js";\n', "import .* cannot be joined"),
        ("export default 3;\n", "export default 3.* cannot be joined"),
        ('import { page } from "./page.js";\n', "page.js imports two.js imports page.js: expected no circle"),
    ],
)
def test_what_cannot_be_joined_is_refused_by_name(page: Path, source: str, refusal: str) -> None:
    (page / "two.js").write_text(source)
    with pytest.raises(ValueError, match=refusal):
        joined_modules("page.js")


def test_every_module_of_the_page_is_in_the_joined_file() -> None:
    script = joined_modules(SCRIPT)
    assert script.count("(() => {") > 40
    assert "\nimport " not in script
    assert "\nexport " not in script


def test_a_page_links_to_its_joined_files_which_are_compressed_and_kept_for_good(
    client: httpx.Client, study: dict[str, Any]
) -> None:
    page = client.get(study["path"])
    assert page.headers["Content-Encoding"] == "gzip"
    for name in (SCRIPT, STYLES):
        assert joined_address(name) in page.text
        file = client.get(joined_address(name))
        assert (file.headers["Content-Encoding"], file.headers["Cache-Control"]) == ("gzip", FOR_GOOD)
        plain = client.get(joined_address(name), headers={"Accept-Encoding": "identity"})
        assert "Content-Encoding" not in plain.headers
        assert plain.content == file.content


def test_a_page_from_before_an_update_gets_the_present_file_and_keeps_it_not(client: httpx.Client) -> None:
    old = client.get(f"/static/joined/0123456789abcdef/{SCRIPT}")
    assert (old.status_code, old.headers["Cache-Control"]) == (200, "no-cache")
    assert client.get("/static/joined/0123456789abcdef/other.js").status_code == 404


def test_the_styles_name_no_other_file() -> None:
    folder = packaged("static") / "css"
    for name in joined.STYLE_SHEETS:
        assert "url(" not in (folder / f"{name}.css").read_text()
