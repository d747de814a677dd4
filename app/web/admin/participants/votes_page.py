"""List a study's votes with filters, and replay any trial as it was seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Form, Path, Query, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.operations.upkeep.comments import note_on_trial
from app.store.participants.comments import LONGEST_COMMENT, trial_comment_of
from app.store.trials.designs import datasets_of
from app.store.trials.given_trials import (
    MOST_COUNTED,
    SORTABLE,
    SoughtTrials,
    given_labels,
    given_trials,
    n_given_trials,
)
from app.store.trials.trial_records import trial_film, trial_record
from app.study.options.options import parse_options
from app.study.protocols import RATED
from app.web.admin.layout import see, study_page, unix
from app.web.admin.listing import listing
from app.web.gates import Store
from app.web.roles import Acting, AStudy, Looking

MOST_LABELS = 500  # participants to choose from; beyond, a label is typed
KINDS = {
    "": "all",
    "ties": "no preference",
    "unswitched": "never switched",
    "voided": "interrupted",
    "excluded": "not counted",
}
KINDS_OF_PAIRS = ("ties", "unswitched")
REFERENCE = "reference"  # label of a look at it, and the strip of a film that shows it

Note = Annotated[str, Form(max_length=2 * LONGEST_COMMENT)]  # browsers send two characters for each end of a line

router = APIRouter(prefix="/admin/studies/{slug}/votes", include_in_schema=False)


@dataclass(frozen=True)
class Look:
    """A stretch of time in which A, B or the reference was on screen."""

    label: str
    from_ms: float
    to_ms: float


@dataclass(frozen=True)
class Shown:
    """A, B or the reference of a trial, and the strip of the film that shows it."""

    label: str
    item: str
    strip: str
    looks: Sequence[Look]

    @property
    def dwell_ms(self) -> float:
        return sum(look.to_ms - look.from_ms for look in self.looks if look.label == self.label)


@router.get("")
def votes_page(
    request: Request,
    person: Looking,
    study: AStudy,
    database: Store,
    participant: Annotated[str, Query(max_length=40)] = "",
    dataset: Annotated[str, Query(max_length=200)] = "",
    what: Annotated[str, Query(max_length=20)] = "",
) -> Response:
    sought, options = SoughtTrials(participant, dataset, what), parse_options(study.options)
    is_rated = options.protocol in RATED
    with database.reading() as connection:
        n_found = n_given_trials(connection, study.id, sought)
        shown = listing(request, n_found, SORTABLE if n_found < MOST_COUNTED else ())
        rows = given_trials(connection, study.id, sought, sort=shown.sort, limit=shown.size, offset=shown.offset)
        people = given_labels(connection, study.id, most=MOST_LABELS)
        datasets = datasets_of(connection, study.id)
    context = {
        "rows": rows,
        "is_rated": is_rated,
        "is_alone": options.is_shown_alone,
        "kinds": {kind: text for kind, text in KINDS.items() if not (is_rated and kind in KINDS_OF_PAIRS)},
        "list": shown,
        "is_counted": n_found < MOST_COUNTED,
        "has_all_people": len(people) < MOST_LABELS,
        "people": people,
        "datasets": datasets,
        "chosen": {"participant": participant, "dataset": dataset, "what": what},
    }
    return study_page(request, "votes", person, study, context)


@router.get("/{trial}")
def replay_page(
    request: Request, person: Looking, study: AStudy, trial: Annotated[str, Path(max_length=32)], database: Store
) -> Response:
    """Show a trial: both films, the reference if there is one, and a time line of what was on screen."""
    with database.reading() as connection:
        record = trial_record(connection, study.id, trial)
        film = trial_film(connection, study.id, trial)
        comment = trial_comment_of(connection, trial)
    if record is None or film is None:
        raise NotFoundError("This study has no such trial.")
    viewing = record["viewing"] or {}
    looks, options = looks_of(viewing, study.exposure_s * 1000), parse_options(study.options)
    b_half = "bottom" if film.a_half == "top" else "top"
    shown = [Shown("a", record["item_a"], film.a_half, looks)]
    if not options.is_shown_alone:
        shown.append(Shown("b", record["item_b"], b_half, looks))
    if reference := options.reference_beside:
        shown.append(Shown(REFERENCE, reference, REFERENCE, looks))
    context = {
        "trial": record,
        "film": film,
        "viewing": viewing,
        "looks": looks,
        "shown": shown,
        "has_pair_films": options.has_pair_films,
        "comment": comment,
        "longest_comment": LONGEST_COMMENT,
    }
    return study_page(request, "replay", person, study, context)


@router.post("/{trial}/comment")
def comment_on(
    actor: Acting,
    study: AStudy,
    trial: Annotated[str, Path(max_length=32)],
    database: Store,
    comment: Note = "",
    seen: Note = "",
) -> Response:
    """Note what was said or seen at a trial; an empty text deletes the note.

    Parameters
    ----------
    seen : the note as the page showed it
    """
    note_on_trial(database, study, trial, unix(comment), actor, unix(seen))
    return see(f"/admin/studies/{study.slug}/votes/{trial}?saved=1")


def looks_of(viewing: dict[str, Any], shown_ms: float) -> Sequence[Look]:
    """Return what was on screen when, from a viewing record; nothing without one.

    Parameters
    ----------
    shown_ms : how long a pair is shown, where the record lacks it
    """
    if "first_shown" not in viewing:
        return ()
    end_ms = float(viewing.get("shown_ms", shown_ms))
    shown, since_ms, looks = viewing["first_shown"], 0.0, []
    for switch in viewing.get("switches", ()):
        looks.append(Look(shown, since_ms, min(switch["at_ms"], end_ms)))
        shown, since_ms = switch["to"], min(switch["at_ms"], end_ms)
    return (*looks, Look(shown, since_ms, end_ms))
