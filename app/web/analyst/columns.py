"""Describe the columns of every table that analysts fetch, for responses, OpenAPI and the archive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any, NamedTuple


class Column(NamedTuple):
    """A column of a table.

    Parameters
    ----------
    meaning : what it holds
    example : a value; None: empty
    stated : kind of the values where the example does not show it; a Parquet file needs it for long tables, and where
        there are no values
    """

    meaning: str
    example: Any = None
    stated: type | None = None

    @property
    def kind(self) -> type:
        """bool, int, float or datetime; str for everything else."""
        return self.stated or (type(self.example) if isinstance(self.example, (bool, int, float)) else str)


Columns = dict[str, Column]


def _some(columns: Columns, names: str) -> Columns:
    return {name: columns[name] for name in names.split()}


VIEWING: dict[str, Any] = {
    "first_shown": "b",
    "shown_ms": 15003.2,
    "response_ms": 1840.5,
    "switches": [
        {"to": "a", "at_ms": 4210.7, "media_time_s": 4.2, "frame": 105, "frame_ms": 4218.2, "presented_ms": 4234.9},
        {"to": "b", "at_ms": 9120.1, "media_time_s": 9.12, "frame": 228, "frame_ms": 9135.0, "presented_ms": 9151.7},
    ],
    "dwell_ms": {"a": 4909.4, "b": 10093.8},
    "n_changes": 1,
    "n_frames": 375,
    "n_dropped": 0,
    "n_mismatches": 0,
    "smoothness": {"longest_gap_ms": 83.3, "n_presented": 374, "n_refreshes": 899},
    "n_stalls": 0,
    "happened": [{"what": "blur", "at_ms": 15904.4}, {"what": "focus", "at_ms": 16310.0}],
    "display": {"window_width": 1920, "window_height": 1080, "device_pixel_ratio": 1.0, "full_screen": True},
}
PARTICIPANT = Column("label, by order of arrival", "P001")
DATASET = Column("dataset (a scene)", "ball")
NOT_SMOOTH = Column("votes whose films were not shown smoothly; empty where that was not recorded", 2)

TRIALS: Columns = {
    "trial": Column("id of the trial", "9f2m4c7w1z5t"),
    "session": Column("id of the session", "3n8v5k2d9x7q"),
    "participant": PARTICIPANT,
    "number": Column("place in the participant's order, from 1", 13),
    "attempt": Column("from 2 for repetitions of an interrupted trial", 1),
    "looks_before": Column(
        "how often the participant had begun to look at the same trial before, and was interrupted", 0
    ),
    "dataset": DATASET,
    "item_a": Column("condition labelled A; in DCR the reference, in ACR the film itself", "approach_2"),
    "item_b": Column("condition labelled B", "approach_1"),
    "first_shown": Column("condition that was on screen first", "approach_2"),
    "role": Column("main, or what the trial checks about the participant", "main"),
    "served_at": Column("when it was sent to the participant", "2026-03-01T12:04:12+00:00", stated=datetime),
    "voided_at": Column("when it was interrupted", stated=datetime),
    "void_reason": Column(
        "full screen (was left), hidden, blur (other window in front), resize, suspended, or left the page"
    ),
    "voted_at": Column("when the vote arrived", "2026-03-01T12:04:31+00:00", stated=datetime),
    "protocol": Column("PC, ACR, ACR-HR, DCR or CCR", "PC"),
    "choice": Column("a, b or none; in CCR by the rating's sign; empty in ACR, ACR-HR and DCR", "a"),
    "rating": Column(
        "grade that was given to item_b; in CCR how much better it is than item_a, -3 to 3; empty in PC", stated=int
    ),
    "reference": Column("true if item_b is the study's reference, which ACR-HR hides among the films", False),
    "shown_ms": Column("how long the pair was shown, milliseconds", 15003.2),
    "response_ms": Column("from the voting screen to the vote, milliseconds", 1840.5),
    "n_switches": Column("switches between A and B", 2),
    "both_seen": Column("true if A and B were both on screen", True),
    "press_to_picture_ms": Column(
        "median time from a press to the presented picture, milliseconds; empty where not recorded", 24.2
    ),
    "technique": Column(
        "how A and B were kept in step: stacked, webcodecs or two videos; empty where the client did not say", "stacked"
    ),
    "frame_locked": Column("false if A and B may have been a frame apart at times (two videos)", True),
    "lighter_film": Column(
        "whether the film with fewer bytes was shown, which the study has for slow lines; of both alike", False
    ),
    "n_mismatches": Column("display refreshes at which A and B were seen to be different frames", 0),
    "longest_gap_ms": Column(
        "longest time between two frames on the display, milliseconds; empty where not recorded", 83.3
    ),
    "frame_share": Column(
        "frames presented, of those that a film without drops presents in the time; empty where not recorded", 0.9971
    ),
    "mismatch_share": Column(
        "share of the display's refreshes at which A and B were different frames; empty where not recorded", 0.0
    ),
    "shown_smoothly": Column(
        "false if half of the frames were missing, none came for a second, or pictures came late; empty: unknown", True
    ),
    "viewing": Column("the whole viewing record, as JSON", VIEWING),
}
VOTES: Columns = (
    _some(TRIALS, "participant dataset item_a item_b choice first_shown trial response_ms")
    | {
        "practice": Column("true for practice", False),
        "excluded": Column("true if the vote does not count", False),
        "reason": Column("reason of the exclusion", ""),
    }
    | _some(TRIALS, "role technique frame_locked both_seen looks_before press_to_picture_ms protocol rating reference")
    | _some(TRIALS, "lighter_film longest_gap_ms frame_share mismatch_share shown_smoothly")
)
PARTICIPANTS: Columns = {
    "participant": PARTICIPANT,
    "session": Column("id of the session", "3n8v5k2d9x7q"),
    "stage": Column("stage of the session", "trial"),
    "n_trials": Column("trials planned", 90),
    "n_votes": Column("votes given", 13),
    "n_voided": Column("trials interrupted", 0),
    "mean_response_ms": Column("mean response time, milliseconds", 1712.9),
    "started_at": Column("when the session began", "2026-03-01T11:51:00+00:00", stated=datetime),
    "finished_at": Column("when it finished", stated=datetime),
    "last_vote_at": Column("when the last vote arrived", "2026-03-01T12:04:31+00:00", stated=datetime),
    "withdrawn_at": Column("when the participant withdrew", stated=datetime),
    "group": Column("group that chance has assigned; empty where the study has none", "near"),
    "language": Column("language of all texts of the session; empty: begun by another client than the page", "en"),
    "texts_sha256": Column(
        "SHA-256 of these texts, which are in the archive's texts.json",
        "5d41402abc4b2a76b9719d911017c592f0e4d4b0b0f5d3f9a3f1c2e7d8b6a901",
    ),
    "erased_at": Column("when the participant's data were erased", stated=datetime),
    "excluded": Column("true if excluded by an experimenter", False),
    "reason": Column("reason of the exclusion", ""),
}
COUNTING: Columns = {
    "excluded": Column("true if what the participant gave does not count", False),
    "reason": Column("withdrawn, or the reason of the exclusion", ""),
}
QUESTIONNAIRE: Columns = {
    "participant": PARTICIPANT,
    "question": Column("name of the question, or the spoken question itself", "age"),
    "answer": Column("the answer; empty if it was left out", 34, stated=str),
    "answered_at": Column(
        "when the interview was completed, or the spoken answer noted", "2026-03-01T12:31:07+00:00", stated=datetime
    ),
    "source": Column("written by the participant, or spoken", "written"),
    "experimenter": Column("who noted a spoken answer"),
    **COUNTING,
}
COMMENTS: Columns = {
    "participant": PARTICIPANT,
    "source": Column("written in the questionnaire, spoken in the interview, or noted on a trial", "written"),
    "question": Column("the question as it was asked, or the number of the trial with its dataset", "age"),
    "subject": Column("name of the question, the spoken question, or id of the trial: what a tag is given to", "age"),
    "comment": Column("the comment", "The faces looked like wax."),
    "tags": Column("tags that experimenters have given it, as a list", ["faces", "texture"]),
    "written_at": Column("when it was given or noted", "2026-03-01T12:31:07+00:00", stated=datetime),
    "experimenter": Column("who noted it; empty if the participant wrote it"),
    "dataset": Column("dataset of the trial", "ball"),
    "trial": Column("id of the trial", "9f2m4c7w1z5t"),
    **COUNTING,
}
COMMENT_TAGS: Columns = {
    "tag": Column("name of the tag", "faces"),
    "n_comments": Column("comments that bear it", 9),
    "n_participants": Column("participants who gave these comments", 7),
}
DEMOGRAPHICS: Columns = {
    "among": Column("counted: neither excluded nor withdrawn; everybody: the excluded, too", "counted"),
    "question": Column("name of the question", "age"),
    "text": Column("the question as it was asked", "How old are you?"),
    "answer": Column(
        "option, step of the scale, or left out; empty in the row that sums up a number or scale", 34, stated=str
    ),
    "n": Column("participants who gave this answer, or any", 22),
    "share": Column("their share of those who completed the questionnaire", 0.5),
    "mean": Column("mean of a number or scale", 36.6),
    "sd": Column("its standard deviation in the sample; empty for one participant", 0.75),
    "minimum": Column("smallest answer", 19, stated=float),
    "maximum": Column("largest answer", 59, stated=float),
}
SCORES: Columns = {
    "comparison": Column("all conditions, or the levels of a factor", "all"),
    "dataset": Column("dataset, or all", "ball"),
    "item": Column("condition, or level of the factor", "approach_2"),
    "score": Column("natural log-odds; they sum to zero in each comparison and dataset", 0.93),
    "se": Column("standard error from the observed information", 0.12),
    "se_participant": Column("standard error clustered by participant", 0.15),
    "ci_low": Column("lower end of the 95 % interval", 0.62),
    "ci_high": Column("upper end", 1.24),
    "n_votes": Column("votes on pairs with the item", 13),
    "wins": Column("votes for the item", 61),
    "losses": Column("votes for the other item", 22),
    "ties": Column("votes without preference", 7),
    "status": Column("ok, separated (no finite maximum) or disconnected", "ok"),
    "jod": Column("score / ln 3: one JOD is preferred by 75 %", 0.85),
    "jod_low": Column("lower end of its 95 % interval", 0.56),
    "jod_high": Column("upper end", 1.13),
    "jod_thurstone": Column(
        "score of Thurstone's Case V in JOD; empty with an order effect or without a finite maximum", 0.82
    ),
    "jod_thurstone_low": Column("lower end of its 95 % interval", 0.55),
    "jod_thurstone_high": Column("upper end", 1.09),
    "preference_to_mean": Column("share of decided votes against a condition of the mean score", 0.72),
    "preference_to_mean_low": Column("lower end of its 95 % interval", 0.65),
    "preference_to_mean_high": Column("upper end", 0.78),
    "ci_method": Column("what the interval rests on; empty where there is none", "t on participant errors"),
    "win_probability": Column(
        "probability of being preferred to another condition at random, given a preference", 0.75
    ),
    "penalty": Column("estimate that stands in for a maximum of separated votes; else empty"),
    "letters": Column(
        "conditions that share a letter are not told apart (all pairs, on single datasets of all of them; Holm)", "a"
    ),
    "no_limit": Column(
        "above or below where all decided votes go one way, so that the score has no limit there; else empty"
    ),
    "p_best": Column("probability to have the highest true score, by these votes alone", 0.83),
    "rank_low": Column(
        "first rank that the tests of pairs leave the condition; all such intervals hold together with 95 %", 1
    ),
    "rank_high": Column("last rank", 2),
    "quasi_se": Column("error whose squares add up to that of any difference (quasi-variance)", 0.13),
}
RATINGS: Columns = {
    "dataset": DATASET,
    "condition": Column("condition that was rated", "approach_2"),
    "is_reference": Column("true for the study's reference", False),
    "n_ratings": Column("ratings", 22),
    "n": Column("participants", 22),
    "mos": Column("mean opinion score, on the study's scale", 3.91),
    "sd": Column("standard deviation over participants", 0.75),
    "ci_low": Column("lower end of the 95 % interval of the mean", 0.62),
    "ci_high": Column("upper end", 1.24),
    "dmos": Column("mean differential score to the reference", 4.32),
    "dmos_sd": Column("its standard deviation over participants", 0.89),
    "dmos_low": Column("lower end of its 95 % interval", 3.92),
    "dmos_high": Column("upper end", 4.71),
    "quality": Column("quality, the participants' bias and inconsistency taken off", 3.88),
    "quality_se": Column("its standard error", 0.14),
    "quality_low": Column("lower end of its 95 % interval for ratings by these participants", 3.61),
    "quality_high": Column("upper end", 4.15),
}
COMPARISONS: Columns = {
    "dataset": DATASET,
    "condition": Column("condition that was compared", "approach_2"),
    "n_ratings": Column("ratings of pairs with it", 22),
    "score": Column("how much better it is than the mean of all, in steps of the scale", 0.93),
    "se": Column("its standard error, clustered by participant", 0.12),
    "ci_low": Column("lower end of the 95 % interval", 0.62),
    "ci_high": Column("upper end", 1.24),
}
TRIADS: Columns = {
    "participant": PARTICIPANT,
    "dataset": DATASET,
    "n_items": Column("conditions compared", 6),
    "complete": Column("true if every pair has a vote", True),
    "circular": Column("circular triads of strict preferences", 1),
    "circular_expected_ties": Column("expected circular triads if ties were broken at random", 1.25),
    "circular_max": Column("largest possible number of circular triads", 8),
    "zeta": Column("coefficient of consistence, 1 - circular_expected_ties / circular_max", 0.844),
    "p_value": Column(
        "probability of as few circular triads under random votes on the same pairs, ties in the same places", 0.021
    ),
    "circular_by_chance": Column("expected circular triads under random votes", 5.0),
    "strict_by_chance": Column(
        "expected circular triads of strict preferences under random votes, ties in the same places", 3.25
    ),
}
OBSERVERS: Columns = {
    "participant": PARTICIPANT,
    "flags": Column("what is unusual about the votes; a reason to look, not to exclude", ["unusually many ties"]),
    "remarks": Column("what else is unusual; among honest people, too, somebody nearly always is"),
}
OBSERVERS_OF_PAIRS: Columns = {
    "careless_log_ratio": Column("natural logarithm of the likelihood ratio, careless to honest answers", -4.1),
    "careless_false_alarms": Column("how many of so many honest people would be expected to look as careless", 0.4),
    "careless_evidence": Column("what speaks for careless answers, in words"),
    "n_votes": Column("votes that count", 13),
    "one_side_unseen": Column("votes given although A or B was never on screen; empty where that was not recorded", 0),
    "not_smooth": NOT_SMOOTH,
    "tie_rate": Column("share of votes without preference", 0.08),
    "side_a_rate": Column("share of decided votes for A", 0.52),
    "side_a_expected": Column("the same as everybody's scores explain it", 0.5),
    "side_a_p_value": Column("p-value of their difference; exact up to 500 votes", 0.71),
    "first_shown_rate": Column("share of decided votes for what was shown first", 0.55),
    "first_shown_expected": Column("the same as everybody's scores explain it", 0.5),
    "first_shown_p_value": Column("p-value of their difference; exact up to 500 votes", 0.36),
    "repeated_pairs": Column("pairs judged more than once", 6),
    "repeats_consistent": Column("those of them with the same answer each time", 5),
    "median_response_ms": Column("median response time, milliseconds", 1650.0),
    "fastest_decile_ms": Column("response time that a tenth of the votes stay below, milliseconds", 840.0),
    "median_press_to_picture_ms": Column(
        "median over the votes of press_to_picture_ms; empty where not recorded", 24.2
    ),
    "circular": Column("circular triads over all datasets", 1),
    "circular_p_value": Column("probability of as few circular triads under random votes", 0.021),
    "loglik_per_vote_left_out": Column("log-likelihood per vote under scores fitted without the participant", -0.48),
}
OBSERVERS_OF_RATINGS: Columns = {
    "n_ratings": Column("ratings", 22),
    "mean": Column("mean rating", 36.6),
    "bias": Column("how much higher than the others the participant rates", 0.21),
    "bias_low": Column("lower end of its 95 % interval", -0.05),
    "bias_high": Column("upper end", 0.47),
    "inconsistency": Column("standard deviation of what quality and bias leave", 0.61),
    "inconsistency_low": Column("lower end of its 95 % interval; empty where there is none", 0.5),
    "inconsistency_high": Column("upper end", 0.74),
    "correlation": Column("Pearson's, with the mean opinion scores of the same items", 0.89),
    "bt500_above": Column("ratings far above the mean (ITU-R BT.500)", 1),
    "bt500_below": Column("ratings far below the mean", 0),
    "bt500_share": Column("share of ratings far from the mean", 0.01),
    "bt500_imbalance": Column("how one-sided these are, 0 to 1; empty where there are none", 1.0),
    "is_bt500_outlier": Column("true if ITU-R BT.500 names the participant", False),
    "is_correlation_low": Column("true if the correlation is below 0.75", False),
    "correlation_others": Column("Pearson's, with the means of the others' ratings of the same items", 0.87),
    "unlike_false_alarms": Column("honest people of the study who are expected to lie as far below the others", 3.1),
    "is_one_grade": Column("true if ten ratings or more are all the same", False),
    "not_smooth": NOT_SMOOTH,
}
MEASUREMENTS: Columns = {
    "dataset": DATASET,
    "approach": Column("condition", "approach_2"),
    "measure": Column("name of the objective measure", "accuracy"),
    "value": Column("its value", 3.41),
    "direction": Column("which way is better", "less is better"),
    "unit": Column("its unit", "mm"),
    "better": Column("higher or lower: the direction in one word, as in tables of measures", "lower"),
    "source": Column("what measured it", "validate mesh"),
    "attached_at": Column("when it was attached", "2026-03-02T09:00:00+00:00", stated=datetime),
}
AUDIT: Columns = {
    "entry": Column("number of the entry", 41),
    "at": Column("time", "2026-03-02T09:00:00+00:00", stated=datetime),
    "actor": Column("who did it", "Ada Example"),
    "action": Column("what was done", "study paused"),
    "study": Column("study concerned", "temple"),
    "subject": Column("object or person concerned", "temple"),
    "detail": Column("more, as JSON", {"before": "open"}),
}
JOBS: Columns = {
    "job": Column("id", "4h8s2p6y0r3jWq1x"),
    "kind": Column("kind of job, as /api/v1/jobs/kinds lists them", "reconstruct"),
    "arguments": Column(
        "value of each field of its form, as JSON", {"capture": "ball", "name": "ball", "temporal": True}
    ),
    "output": Column(
        "what it makes or changes, SHELF/NAME; sets are stimulus sets, the rest lies in the intake folder", "runs/ball"
    ),
    "state": Column("queued, running, done, failed or cancelled", "running"),
    "is_cancelling": Column("true if it was cancelled and has not stopped yet", False),
    "step": Column("what is being done", "matching"),
    "done": Column("how much of the step is done", 12),
    "total": Column("how much the step is", 72),
    "left_s": Column("estimate of what is left of the step, seconds; empty where there is none", 95.0),
    "detail": Column("why it failed", ""),
    "actor": Column("who queued it", "Eva"),
    "worker": Column("machine and process that runs it or ran it last", "laboratory 4711 9f2c"),
    "attempt": Column("how often it was begun", 1),
    "created_at": Column("time when it was queued", "2026-03-02T10:15:00+00:00", stated=datetime),
    "started_at": Column("time when it was begun last; empty before", "2026-03-02T10:15:01+00:00", stated=datetime),
    "ended_at": Column("time when it ended; empty before", stated=datetime),
}
STUDIES: Columns = {
    "slug": Column("name in addresses", "temple"),
    "name": Column("name", "Temple"),
    "state": Column("open, paused, closed or archived", "open"),
    "exposure_s": Column("how long a pair is shown, seconds", 15.0),
    "created_at": Column("when it was created", "2026-02-27T08:30:00+00:00", stated=datetime),
    "n_datasets": Column("datasets", 6),
    "n_conditions": Column("conditions", 6),
    "n_pairs": Column("pairs", 90),
    "n_started": Column("participants who began", 14),
    "n_finished": Column("participants who finished", 11),
    "n_votes": Column("votes", 13),
}
SCREENING: Columns = {
    "participant": PARTICIPANT,
    "session": Column("id of the session", "3n8v5k2d9x7q"),
    "test": Column("what was tested", "acuity"),
    "verdict": Column("what the screening found; it is no diagnosis", "passed"),
    "logmar": Column("acuity, logMAR", -0.04),
    "low": Column("lower end of its 95 % interval", -0.09),
    "high": Column("upper end", 0.01),
    "limit": Column("limit that the study sets", 0.18),
    "smallest": Column("smallest ring that the display can draw, logMAR", -0.21),
    "pixel_mm": Column("pitch of the display's pixels, mm", 0.277),
    "distance_mm": Column("distance of the eyes, mm", 700.0),
    "distance_source": Column("how the distance was measured", "typed"),
    "n_answered": Column("rings or plates answered", 24),
    "started_at": Column("when the test began", "2026-03-01T11:51:00+00:00", stated=datetime),
    "finished_at": Column("when it ended, or its result was entered", stated=datetime),
    "is_bound": Column("is the acuity this or better, because the display draws no smaller rings?", False),
    "result_source": Column(
        "screen: tested on the page; entered: by an experimenter, from a chart or another test", "entered"
    ),
    "instrument": Column("chart, plates or device of an entered result", "Landolt C chart at 4 m"),
    "result": Column("entered result, as it was read", "0.1 logMAR, both eyes"),
    "experimenter": Column("who entered it"),
    **COUNTING,
    "details": Column("more, as JSON", {"n_not_seen": 3}),
}
FAILURES: Columns = {
    "participant": PARTICIPANT,
    "film": Column("what the film shows: dataset and conditions, or the practice", "ball: approach_1 and approach_2"),
    "trial": Column("id of the trial", "9f2m4c7w1z5t"),
    "why": Column("what the browser says", "Error: the film stands still"),
    "browser": Column("browser and system", "Firefox on Linux"),
    "happened_at": Column("when it was told", "2027-03-02T10:15:00+00:00", stated=datetime),
    "noted_at": Column(
        "when an experimenter took note, or the study was opened again; empty: not yet", stated=datetime
    ),
}
FILES: Columns = {
    "kind": Column("shelf of the Files page", "captures"),
    "name": Column("of the file or folder", "ball"),
    "size": Column("bytes of all files in it", 734003200),
    "changed_at": Column("newest change of a file in it", "2026-03-01T12:31:07+00:00", stated=datetime),
    "summary": Column("what it holds, or what is wrong with it", "72 frames of 3 sensors"),
}
SETS: Columns = {
    "name": Column("in addresses", "Temple"),
    "title": Column("name", "Temple"),
    "sha256": Column("digest of its manifest", "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"),
    "n_films": Column("films", 36),
    "conditions": Column("names of its conditions, as JSON", ["approach_1", "approach_2"]),
    "datasets": Column("names of its datasets, as JSON", ["ball", "box"]),
    "factors": Column("levels by factor, as JSON", {"light": ["front", "side"]}),
    "is_here": Column("true if it lies in the server's folder of stimulus sets", True),
    "studies": Column("names of the studies made of it, as JSON", ["temple"]),
}
OUTSIDE_IDS: Columns = {
    "participant": PARTICIPANT,
    "outside_id": Column("id on the recruiting platform; empty: came without one", "5f1e0c9d8b7a"),
    "state": Column("how far the participant is", "open"),
    "completion_code": Column("that the participant was given; empty before the end", "C1X2Y3"),
}
FIGURES: Columns = {
    "figure": Column("name in addresses", "scores_all"),
    "caption": Column("what it shows", "Scores of all conditions."),
}
TABLES: dict[str, Columns] = {
    "votes": VOTES,
    "trials": TRIALS,
    "participants": PARTICIPANTS,
    "screening": SCREENING,
    "questionnaire": QUESTIONNAIRE,
    "comments": COMMENTS,
    "comment_tags": COMMENT_TAGS,
    "demographics": DEMOGRAPHICS,
    "scores": SCORES,
    "ratings": RATINGS,
    "comparisons": COMPARISONS,
    "triads": TRIADS,
    "observers": OBSERVERS,
    "validation": MEASUREMENTS,
    "audit": AUDIT,
    "failures": FAILURES,
}
FURTHER: dict[str, Columns] = {  # columns that the study's protocol decides about
    "observers": OBSERVERS_OF_PAIRS | OBSERVERS_OF_RATINGS
}
EVERY: tuple[Columns, ...] = (*TABLES.values(), *FURTHER.values(), STUDIES, JOBS, SETS, FILES, OUTSIDE_IDS, FIGURES)
KINDS = {name: column.kind for columns in EVERY for name, column in columns.items()}


def example_row(columns: Columns) -> dict[str, Any]:
    """Return an example of a table's row."""
    return {name: column.example for name, column in columns.items()}


def with_others(columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the documented columns of a table, then any others of its rows."""
    return list(dict.fromkeys([*columns, *(name for row in rows for name in row)]))
