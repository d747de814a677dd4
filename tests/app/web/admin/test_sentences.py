"""The dashboard's sentences in the states that are easily forgotten: nobody yet, one participant, one film a trial."""

from __future__ import annotations

import re
from collections import Counter, deque
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit

import pytest

from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import simulate
from app.study.options.options import parse_options
from tests.app.sentences import OF_ONE, OF_PROGRAMS, words_of
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

MOST_OF_A_SHAPE = 2  # addresses that differ in names and numbers alone
SETTINGS = "/admin/settings"  # shows what the environment says
STATES = {
    "nobody": ({}, 0),
    "one": ({}, 1),
    "one who rates": ({"protocol": "ACR"}, 1),
    "one who compares in grades": ({"protocol": "CCR"}, 1),
    "two": ({"repeated_pairs": 1, "identical_pairs": 1}, 2),
}


def shape_of(address: str) -> str:
    return re.sub(r"(?<=/votes/)[\w-]+|\d+", "#", address)


def crawled(dashboard: Dashboard, slug: str) -> dict[str, str]:
    """Return the pages about a study, and those that belong to none, by their addresses."""
    pages: dict[str, str] = {}
    seen, shapes, waiting = {"/admin"}, Counter[str](), deque([f"/admin/studies/{slug}", "/admin"])
    while waiting:
        path = waiting.popleft()
        answer = dashboard.results(path) if path.endswith("/results") else dashboard.get(path).text
        if "<html" not in answer:
            continue
        pages[path] = answer
        for link in re.findall(r'href="([^"#]+)', answer):
            address = urljoin(path, link.replace("&amp;", "&"))
            parts = urlsplit(address)
            is_ours = parts.path == f"/admin/studies/{slug}" or parts.path.startswith(f"/admin/studies/{slug}/")
            is_general = parts.path.startswith("/admin/") and not parts.path.startswith("/admin/studies/")
            shape = shape_of(address)
            if not (is_ours or is_general) or address in seen or re.search("sort=|language=|[.]vega|figures/", address):
                continue
            seen.add(address)
            shapes[shape] += 1
            if shapes[shape] <= MOST_OF_A_SHAPE:
                waiting.append(address)
    return pages


@pytest.mark.slow
@pytest.mark.parametrize("state", STATES)
def test_no_page_counts_one_as_many_nor_speaks_as_a_program(
    state: str, server: str, token: str, settings: Settings, stimulus_set: Path
) -> None:
    options, people = STATES[state]
    chosen = parse_options(options)
    study: dict[str, Any] = create_study(
        settings, stimulus_set, f"Sentences of {state}", exposure_s=0.4, seed=1, options=chosen
    )
    if people:
        simulate(
            server, study["slug"], study["invitation"], token, people, {"id_fa": 0, "id_fb": 0, "pm_fb": 1}, seed=2
        )
    with signed_in(server, settings, f"Sarah {state}") as sarah:
        pages = crawled(sarah, study["slug"])
    assert len(pages) > 40
    said = {path: words_of(page) for path, page in pages.items()}
    assert {
        path: found for path, text in said.items() if (found := [match[0] for match in OF_ONE.finditer(text)])
    } == {}
    ours = {path: text for path, text in said.items() if not path.startswith(("/admin/manual", SETTINGS))}
    assert {path: found for path, text in ours.items() if (found := OF_PROGRAMS.findall(text))} == {}
    ids = {path: set(re.findall(r'id="([^"]+)"', page)) for path, page in pages.items()}
    links = {
        (path, link)
        for path, page in pages.items()
        for link in re.findall(r'href="([^"]*#[^"]+)"', page)
        if (where := urljoin(path, link).partition("#"))[0] in ids and where[2] not in ids[where[0]]
    }
    assert links == set()
