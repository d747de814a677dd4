"""Every form of a page sends what its route takes: a form with another field is refused."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from app.main import create_app
from app.settings import Settings
from app.web.gates import FORM_TOKEN, WHOLE_FORMS, fields_of
from tests.app.web.http_checks import all_routes

TEMPLATES = Path(__file__).parents[3] / "templates"
FORM = re.compile(r"<form\b([^>]*)>(.*?)</form>", re.DOTALL)
BASES = ("/admin/studies/x", "/admin/files/captures/x", "/admin/files/votes/x")  # what `base` stands for in templates


def forms() -> Iterator[tuple[str, str, set[str]]]:
    """Each form's template, address with `x` for what is filled in, and names of its fields."""
    for path in sorted(TEMPLATES.rglob("*.html")):
        for attributes, inside in FORM.findall(path.read_text(encoding="utf-8")):
            if 'method="post"' in attributes:
                action = re.search(r'action="(.*?)(\?[^"]*|\{% ?if[^"]*)?"', attributes)
                assert action, f"{path.name} has a form without an address"
                names = set(re.findall(r'\bname="([^"{]+)"', inside)) | {FORM_TOKEN}
                yield path.name, re.sub(r"\{\{ ?(base|entry) ?\}\}", "BASE", action[1]), names


def test_every_form_sends_what_its_route_takes(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path))
    app.state.database.dispose()
    routes = [route for route in all_routes(app.routes) if hasattr(route, "dependant") and "POST" in route.methods]
    n_forms = 0
    for template, action, names in forms():
        addresses = [re.sub(r"\{[{%].*?[}%]\}", "x", action.replace("BASE", base)) for base in BASES]
        takers = [
            route.dependant
            for route in routes
            if any(re.fullmatch(re.sub(r"\{[^}]+\}", "[^/]+", route.path), address) for address in addresses)
        ]
        assert takers, f"{template}: nothing takes the form sent to {action}"
        taken = [set(fields_of(taker)) | {FORM_TOKEN} for taker in takers]
        is_whole = any(call in WHOLE_FORMS for taker in takers for call in (each.call for each in taker.dependencies))
        assert is_whole or any(names <= known for known in taken), (
            f"{template}: {action} takes {taken}, is sent {names}"
        )
        n_forms += 1
    assert n_forms > 40
