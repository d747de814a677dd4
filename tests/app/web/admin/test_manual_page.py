"""The server has its manual: every page leads to its own of it, and links within it lead somewhere."""

from __future__ import annotations

import re
from functools import cache

import pytest

from app.files import packaged
from app.web.admin.layout import MANUAL
from app.web.admin.manual_page import PAGES, text_of
from app.web.markdown import render_manual
from tests.app.web.admin.dashboard_client import Dashboard


@cache
def rendered(name: str) -> str:
    return str(render_manual(text_of(name), PAGES))


def leads_somewhere(place: str) -> bool:
    name, _, heading = place.partition("#")
    return name in PAGES and (not heading or f'id="{heading}"' in rendered(name))


def test_every_page_of_the_dashboard_leads_to_its_place_in_the_manual() -> None:
    templates = packaged("templates") / "admin"
    pages = {
        path.stem
        for path in templates.glob("[!_]*.html")
        if re.match(r'{% extends "admin/_(layout|study).html"', path.read_text(encoding="utf-8"))
    }
    assert {name: place for name, place in MANUAL.items() if not leads_somewhere(place)} == {}
    assert MANUAL.keys() <= pages


@pytest.mark.parametrize("name", PAGES)
def test_every_link_and_picture_of_the_manual_is_there(name: str) -> None:
    for link in re.findall(r'href="(?:/admin/manual/)?([^":]*)"', rendered(name)):
        assert leads_somewhere(f"{name}{link}" if link.startswith("#") else link), link
    for picture in re.findall(r'src="/admin/manual/pictures/([^"]+)"', rendered(name)):
        assert (packaged("docs") / "pictures" / picture).is_file()


def test_the_manual_is_served_with_its_pictures_and_nothing_else(experimenter: Dashboard) -> None:
    assert "A study" in experimenter.get("/admin/manual").text
    page = experimenter.get("/admin/manual/experimenter").text
    picture = re.search(r'src="(/admin/manual/pictures/[^"]+)"', page)
    assert picture
    assert experimenter.get(picture[1]).headers["content-type"].startswith("image/")
    for path in ("/admin/manual/reference.py", "/admin/manual/..%2Fapp", "/admin/manual/pictures/..%2Freference.py"):
        assert experimenter.get(path).status_code == 404
    assert 'href="/admin/manual/experimenter#a-study"' in experimenter.get("/admin/studies/new").text
