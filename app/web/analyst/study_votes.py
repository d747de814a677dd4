"""The votes of studies as the analysis takes them, kept between requests so that only new ones are read."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from app.store.database.engine import Transaction
from app.store.trials.counted_votes import (
    Judge,
    KnownVotes,
    VoteColumns,
    VoteState,
    counted_votes,
    judges_of,
)
from app.store.trials.designs import ShownPair, shown_pairs

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from app.analysis.reading.votes_table import VotesTable

STUDIES_KEPT = 8  # a million votes take 50 MB
WITHDRAWN = "withdrawn"


class _Studies:
    """The votes of the studies that were asked for last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._known: OrderedDict[tuple[str, int], KnownVotes] = OrderedDict()

    def read(self, connection: Transaction, study_id: int, state: VoteState) -> VoteColumns:
        """Return a study's votes, reading from the database those that came since it was asked for last."""
        key = (str(connection.engine.url), study_id)
        with self._lock:
            known = self._known.get(key)
        now = counted_votes(connection, study_id, state, known)
        with self._lock:
            self._known[key] = now
            self._known.move_to_end(key)
            while len(self._known) > STUDIES_KEPT:
                self._known.popitem(last=False)
        return now.votes


_studies = _Studies()


def read_votes_table(
    connection: Transaction, study_id: int, state: VoteState, *, with_excluded: bool = False
) -> tuple[VotesTable, NDArray[np.float64]] | None:
    """Return a study's votes, as `votes_from_rows` would from its table of votes, and their ratings; None without any.

    Parameters
    ----------
    state : of the votes now, from the same transaction
    with_excluded : count participants whom the experimenter has excluded, too
    """
    votes = _studies.read(connection, study_id, state)
    if not len(votes):
        return None
    judges = judges_of(connection, study_id)
    votes = in_order_of_participants(votes, judges)
    return votes_table(votes, judges, shown_pairs(connection, study_id), with_excluded=with_excluded), votes.rating


def in_order_of_participants(votes: VoteColumns, judges: Mapping[int, Judge]) -> VoteColumns:
    """Return votes in the order of their participants and trials."""
    import numpy as np

    sessions, who = np.unique(votes.session, return_inverse=True)
    slot = np.array([judges[int(key)].slot for key in sessions])[who]
    return votes.in_order(np.lexsort((votes.attempt, votes.position, slot)))


def votes_table(
    votes: VoteColumns, judges: Mapping[int, Judge], pairs: Mapping[int, ShownPair], *, with_excluded: bool = False
) -> VotesTable:
    """Return votes with names in place of ids.

    Parameters
    ----------
    votes : in the order of their participants and trials
    judges : by session
    pairs : by id
    with_excluded : as in `read_votes_table`
    """
    import numpy as np

    from app.analysis.reading.votes_table import VotesTable

    sessions, who = np.unique(votes.session, return_inverse=True)
    people = [judges[int(key)] for key in sessions]
    keys, which = np.unique(votes.pair, return_inverse=True)
    shown = [pairs[int(key)] for key in keys]
    conditions = sorted({name for pair in shown for name in (pair.top, pair.bottom)})
    top, bottom = (
        np.array([conditions.index(getattr(pair, half)) for pair in shown])[which] for half in ("top", "bottom")
    )
    item_a, item_b = np.where(votes.a_is_top, top, bottom), np.where(votes.a_is_top, bottom, top)
    both, items = _in_order(np.concatenate([item_a, item_b]), conditions)
    participant, participants = _in_order(who, [judge.label for judge in people])
    named = sorted({pair.dataset for pair in shown})
    dataset, datasets = _in_order(np.array([named.index(pair.dataset) for pair in shown])[which], named)
    reasons = [WITHDRAWN if judge.has_withdrawn else judge.reason for judge in people]
    excluded = [reason == WITHDRAWN if with_excluded else reason is not None for reason in reasons]
    return VotesTable(
        participants,
        datasets,
        items,
        participant=participant,
        dataset=dataset,
        item_a=both[: len(votes)],
        item_b=both[len(votes) :],
        choice=votes.choice,
        first_shown=np.where(votes.a_is_first | (item_a == item_b), 0, 1).astype(np.int8),
        both_seen=votes.both_seen,
        shown_smoothly=votes.shown_smoothly,
        count=np.ones(len(votes), np.int64),
        response_ms=votes.response_ms,
        press_to_picture_ms=votes.press_to_picture_ms,
        practice=np.zeros(len(votes), bool),
        excluded=np.array(excluded, bool)[who],
        reason=np.array([reason or "" for reason in reasons], object)[who],
        role=votes.role,
    )


def _in_order(codes: Any, names: list[str]) -> tuple[Any, tuple[str, ...]]:
    """Return codes and names in the order of appearance, without names that do not appear."""
    import pandas as pd

    appearing, present = pd.factorize(codes)
    return appearing.astype("int32"), tuple(names[key] for key in present)
