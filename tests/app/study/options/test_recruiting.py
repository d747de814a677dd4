"""The options of recruiting say what is wrong with them, and addresses take only what they name."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.options.options import parse_options
from app.study.options.platforms import PLATFORMS
from app.study.options.recruiting import VALUE, Arrival, LimitOptions

IDS = st.from_regex(VALUE, fullmatch=True)


@given(IDS, IDS)
def test_a_platform_reads_in_the_address_what_it_had_sent(outside_id: str, kept: str) -> None:
    options = parse_options(
        {"outside": {"id": "P", "keep": ["S"], "complete_url": "https://a.b/?p={id}&s={S}"}}
    ).outside
    address = options.address("complete", options.arrival({"P": outside_id, "S": kept, "X": "y"}))
    assert parse_qs(urlsplit(address).query) == {"p": [outside_id], "s": [kept]}


def test_what_a_link_lacks_is_left_empty_in_the_address() -> None:
    options = parse_options({"outside": {"id": "P", "keep": ["S"], "full_url": "https://a.b/{id}?s={S}"}}).outside
    assert options.address("full", Arrival("x+y")) == "https://a.b/x%2By?s="


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (3, "outside is 3, expected a table"),
        ({"ids": "P"}, "'ids' is not known; expected some of id, keep"),
        ({"id": "P ID"}, "id is 'P ID', expected the name of a parameter"),
        ({"id": "language"}, "'language' has a meaning here already"),
        ({"id": "P", "keep": ["P"]}, "named twice"),
        ({"keep": ["P"]}, "keep needs id"),
        ({"id": "P", "keep": "SID"}, "expected a list of at most 10"),
        ({"resume": "never"}, "expected one of anywhere, same browser"),
        ({"code": "a b"}, "code is 'a b', expected 1 to 40 letters"),
        ({"code": "a", "random_codes": True}, "expected one of them"),
        ({"complete_url": "http://a.b/"}, "expected an address that begins with https://"),
        ({"complete_url": "javascript:alert(1)"}, "expected an address that begins with https://"),
        ({"complete_url": "https://{id}.b/", "id": "P"}, "expected an address"),
        ({"complete_url": "https://a.b@c.d/"}, "expected an address"),
        ({"complete_url": "https://a.b/?c={code}"}, r"holds \{code\}, expected no placeholder with these options"),
        ({"id": "P", "code": "C", "full_url": "https://a.b/?c={code}"}, r"holds \{code\}, expected \{id\}"),
        ({"redirect_after_s": 601}, "expected a whole number from 0 to 600"),
    ],
)
def test_an_option_of_the_way_there_and_back_that_is_wrong_is_named(content: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options({"outside": content})


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"finished": -1}, "finished is -1, expected a whole number"),
        ({"minutes": 1.5}, "minutes is 1.5, expected a whole number"),
        ({"open_until": "tomorrow"}, "open_until is 'tomorrow', expected a date and time with its zone"),
        ({"open_until": "2027-03-31T18:00"}, "expected a date and time with its zone"),
    ],
)
def test_a_limit_that_is_wrong_is_named(content: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options({"limits": content})


@pytest.mark.parametrize("moment", ["2027-03-31T18:00+02:00", datetime(2027, 3, 31, 16, tzinfo=UTC)])
def test_a_study_is_open_until_its_moment(moment: Any) -> None:
    limits = parse_options({"limits": {"open_until": moment}}).limits
    end = datetime(2027, 3, 31, 16, tzinfo=UTC)
    assert [limits.is_over(end + timedelta(seconds=later)) for later in (-1, 0)] == [False, True]


@pytest.mark.parametrize(
    ("limits", "counts", "is_full"),
    [
        (LimitOptions(), (9, 9), False),
        (LimitOptions(finished=3), (1, 1), False),
        (LimitOptions(finished=3), (1, 2), True),
        (LimitOptions(under_way=2), (9, 1), False),
        (LimitOptions(under_way=2), (0, 2), True),
    ],
)
def test_a_study_is_full_when_those_under_way_may_fill_it(
    limits: LimitOptions, counts: tuple[int, int], is_full: bool
) -> None:
    assert limits.is_full(*counts) is is_full


@pytest.mark.parametrize("name", [name for name in PLATFORMS if name])
def test_nobody_of_a_platform_is_left_without_a_way_home_whose_film_fails_or_whom_nobody_takes_in(name: str) -> None:
    platform = PLATFORMS[name]
    given = dict.fromkeys(platform.needed, "abc")
    outside = parse_options({"outside": platform.filled(given)}).outside
    for ending in ("failed", "full"):
        assert outside.address(ending, None).startswith("https://")
