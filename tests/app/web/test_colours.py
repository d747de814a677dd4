"""The pages' colours differ as much as people need who see little (WCAG 2.2, 1.4.3 and 1.4.11)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

STYLES = Path(__file__).parents[3] / "static/css"
PAPERS = ("paper", "paper-raised", "paper-sunken")


def colours(name: str) -> dict[str, str]:
    """Colours by name, of a file of tokens."""
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", (STYLES / name).read_text(encoding="utf-8")))


def contrast(first: str, second: str) -> float:
    """Contrast ratio of WCAG 2.2, 1 to 21."""
    darker, lighter = sorted(map(_luminance, (first, second)))
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: str) -> float:
    parts = [int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def test_the_contrast_is_that_of_the_standard() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#ffffff", "#767676") == pytest.approx(4.54, abs=0.005)


@pytest.mark.parametrize("tokens", ["tokens.css", "tokens-dark.css"])
def test_edges_of_controls_are_told_from_every_paper_and_words_read_on_it(tokens: str) -> None:
    known = colours(tokens)
    for paper in PAPERS:
        assert contrast(known["line-strong"], known[paper]) >= 3, paper
        for ink in ("ink", "ink-soft", "accent", "accent-deep", "good", "warn", "bad"):
            assert contrast(known[ink], known[paper]) >= 4.5, (ink, paper)
    for ink in ("good", "warn", "bad", "accent"):
        assert contrast(known[ink], known[f"{ink}-tint"]) >= 4.5, ink
    assert contrast(known["on-accent"], known["accent"]) >= 4.5


@pytest.mark.parametrize("control", [".button", ".field"])
def test_controls_have_such_edges(control: str) -> None:
    rules = re.findall(r"([^{}]+)\{([^{}]*)\}", (STYLES / "base.css").read_text(encoding="utf-8"))
    of_control = [body for names, body in rules if control in re.split(r"[,\s]+", names.strip())]
    assert any("border: 1px solid var(--line-strong)" in body for body in of_control)
