"""Routers may stand in any order: an address leads to one page, and no study or person can have a page's name."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from starlette.routing import Match, Route

from app.intake.shelves import KINDS
from app.operations.studies.create import slugify
from app.store.database.keys import new_opaque_id
from app.web.participant import votes
from app.web.routers import ROUTERS, joined_routers

NO_NAME: dict[str, Callable[[str], bool]] = {  # by placeholder: can nothing that it stands for have this name?
    "slug": lambda word: slugify(word) != word,
    "kind": lambda word: word not in KINDS,
    "label": lambda word: (
        re.fullmatch(r"(P|preview)\d+", word) is None
    ),  # labels are counted: app/store/trials/admission.py
    "job": lambda word: len(word) != len(new_opaque_id()),
    "number": lambda word: not word.isdecimal(),
}


def routes_of(routers: Any) -> list[Route]:
    return [route for route in joined_routers(routers).routes if isinstance(route, Route)]


def page_at(routes: list[Route], method: str, address: str) -> Any:
    """The function that answers an address."""
    scope = {"type": "http", "method": method, "path": address, "root_path": ""}
    return next(route.endpoint for route in routes if route.matches(scope)[0] == Match.FULL)


def addresses(routes: list[Route]) -> Iterator[tuple[str, str]]:
    for route in routes:
        for method in route.methods or ():
            yield method, re.sub(r"\{[^}]+\}", "1", route.path)


@pytest.mark.parametrize("seed", range(3))
def test_an_address_leads_to_the_same_page_whatever_the_order_of_the_routers(seed: int) -> None:
    today = routes_of(ROUTERS)
    shuffled = routes_of(random.Random(seed).sample(ROUTERS, len(ROUTERS)))
    for method, address in addresses(today):
        assert page_at(today, method, address) is page_at(shuffled, method, address), f"{method} {address}"


def test_no_two_routes_have_one_address() -> None:
    every = [*routes_of(ROUTERS), *(route for route in votes.router.routes if isinstance(route, Route))]
    taken = [(method, re.sub(r"\{[^}]+\}", "{}", route.path)) for route in every for method in route.methods or ()]
    assert len(set(taken)) == len(taken)


def hidden_names(routes: list[Route]) -> Iterator[tuple[str, str]]:
    """Each placeholder with a word that another page has in its place."""
    for page in routes:
        for other in routes:
            if page is not other and (page.methods or set()) & (other.methods or set()):
                yield from hidden_by(page.path, other.path)


def hidden_by(page: str, other: str) -> list[tuple[str, str]]:
    words, places = page.split("/"), other.split("/")
    pairs = list(zip(words, places, strict=False))
    is_hidden = len(words) == len(places) and all("{" in word + place or word == place for word, place in pairs)
    return [(place[1:-1], word) for word, place in pairs if is_hidden and "{" in place and "{" not in word]


def test_nothing_can_have_a_name_that_is_a_pages_place() -> None:
    hidden = set(hidden_names(routes_of(ROUTERS)))
    assert ("slug", "new") in hidden
    assert ("label", "comments") in hidden
    for placeholder, word in sorted(hidden):
        assert NO_NAME[placeholder](word), f"a {placeholder} called {word!r} could not be reached"
