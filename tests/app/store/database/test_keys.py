from __future__ import annotations

from app.files import without_formula
from app.store.database.keys import new_opaque_id


def test_an_id_is_the_same_in_a_spreadsheets_csv() -> None:
    ids = [new_opaque_id() for _ in range(2000)]  # a sixty-fourth of them began with a hyphen
    assert [without_formula(each) for each in ids] == ids
    assert len(set(ids)) == len(ids)
    assert {len(each) for each in ids} == {16}
