"""Until when a study keeps what is personal in its participants' data."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from app.study.options.options import parse_options
from app.study.options.privacy import check_days_left, forgets_at

NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


def test_days_are_counted_from_the_end_of_a_study() -> None:
    options = parse_options({"privacy": {"keep_days": 30}, "limits": {"open_until": NOW.isoformat()}})
    assert forgets_at(options, None) == NOW + timedelta(days=30)
    assert forgets_at(options, NOW - timedelta(days=1)) == NOW + timedelta(days=29)


def test_a_study_that_is_open_until_the_last_day_of_all_keeps_its_data() -> None:
    options = parse_options({"privacy": {"keep_days": 30}, "limits": {"open_until": "9999-12-31T23:59+00:00"}})
    assert forgets_at(options, None) is None
    check_days_left(options, None, NOW)
