from __future__ import annotations

import pytest

from app.web.pages import languages, preferred_language, texts_in

AVAILABLE = frozenset({"en", "de"})


@pytest.mark.parametrize(
    ("accepted", "language"),
    [
        ("", "en"),
        ("de", "de"),
        ("de-AT,de;q=0.9,en;q=0.8", "de"),
        ("fr, en;q=0.5, de;q=0.7", "de"),
        ("fr;q=1.0", "en"),
        ("de;q=much, *", "en"),
        (";;,,q=", "en"),
    ],
)
def test_the_language_is_the_readers_first_that_there_is(accepted: str, language: str) -> None:
    assert preferred_language(accepted, AVAILABLE) == language


def test_every_language_has_the_same_texts() -> None:
    shapes = [_places(texts_in(language)) for language in sorted(languages())]
    assert all(shape == shapes[0] for shape in shapes)


def _places(texts: object, at: str = "") -> set[str]:
    if isinstance(texts, dict):
        return set().union(*(_places(text, f"{at}.{key}") for key, text in texts.items()))
    return {at}
