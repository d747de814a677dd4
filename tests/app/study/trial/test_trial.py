from __future__ import annotations

import pytest

from app.study.trial.trial import Items, reveal


@pytest.mark.parametrize(
    ("a_half", "first_shown", "expected"),
    [
        ("top", "a", Items("over", "under", "over")),
        ("top", "b", Items("over", "under", "under")),
        ("bottom", "a", Items("under", "over", "under")),
        ("bottom", "b", Items("under", "over", "over")),
    ],
)
def test_labels_are_traced_back_to_conditions(a_half: str, first_shown: str, expected: Items) -> None:
    assert reveal("over", "under", a_half, first_shown) == expected
