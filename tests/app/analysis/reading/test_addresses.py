"""Conditions that are addresses of films, with a key for each look: one film, one condition."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.analysis.ratings.reading import understand_ratings
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import Source, recognise_file


def source(folder: Path, text: str) -> Source:
    (folder / "table.csv").write_text(text, encoding="utf-8")
    return recognise_file(folder / "table.csv")


def test_a_film_with_a_key_for_each_look_is_one_condition(tmp_path: Path) -> None:
    rows = [f"{who},https://x/{film}.mp4?token={who}{film}&e=1,4" for who in "ABCD" for film in "yz"]
    table, said = understand_ratings(source(tmp_path, "\n".join(["participant,condition,rating", *rows])))
    assert [condition for _, condition in table.items] == ["https://x/y.mp4?e=1", "https://x/z.mp4?e=1"]
    assert "addresses are taken without token: 8 become 2" in said[0]


def test_choices_that_are_addresses_lose_the_same_key_as_the_items(tmp_path: Path) -> None:
    a, b = "https://x/y.mp4?X-Amz-Date=1&X-Amz-Signature={}1", "https://x/z.mp4?X-Amz-Date=2&X-Amz-Signature={}2"
    rows = [f"{who},{a.format(who)},{b.format(who)},{a.format(who)}" for who in "ABCD"]
    votes, _ = understand_votes([source(tmp_path, "\n".join(["participant,left,right,choice", *rows]))])
    assert votes.items == ("https://x/y.mp4", "https://x/z.mp4")
    assert votes.choice.tolist() == [0] * 4


def test_a_key_of_no_known_name_is_one_if_it_never_repeats(tmp_path: Path) -> None:
    rows = [f"{who},{who},https://x/{film}.mp4?u=0123{who}{film},4" for who in "ABCDEF" for film in "yz"]
    table, said = understand_ratings(source(tmp_path, "\n".join(["participant,dataset,condition,rating", *rows])))
    assert len({condition for _, condition in table.items}) == 2
    assert "addresses are taken without u: 12 become 2" in said[0]


@pytest.mark.parametrize("address", ["https://x/{}.mp4?q=28", "https://x/get?v={}", "https://x/get?token={}"])
def test_what_tells_films_apart_stays(tmp_path: Path, address: str) -> None:
    rows = [f"{who},{address.format(film)},4" for who in "ABCD" for film in "yz"]
    rows += [f"{who},{address.format('y').replace('28', '35')},3" for who in "ABCD"]
    table, said = understand_ratings(source(tmp_path, "\n".join(["participant,condition,rating", *rows])))
    assert len(table.items) == 2 + ("28" in address)
    assert "addresses are taken" not in said[0]
