"""Describe the columns of every table that analysts fetch, for responses, OpenAPI and the archive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

Columns = dict[str, str]  # meaning by name

PARTICIPANT = "label, by order of arrival"
DATASET = "dataset (a scene)"
LIGHTER_FILM = "whether the film with fewer bytes was shown, which the study has for slow lines; of both alike"
TECHNIQUE = "how A and B were kept in step: stacked, webcodecs or two videos; empty where the client did not say"
BOTH_SEEN = "true if A and B were both on screen"
PRESS_TO_PICTURE = "median time from a press to the presented picture, milliseconds; empty where not recorded"
LOOKS_BEFORE = "how often the participant had begun to look at the same trial before, and was interrupted"
CHOICE = "a, b or none; in CCR by the rating's sign; empty in ACR, ACR-HR and DCR"
RATING = "grade that was given to item_b; in CCR how much better it is than item_a, -3 to 3; empty in PC"
REFERENCE = "true if item_b is the study's reference, which ACR-HR hides among the films"
PROTOCOL = "PC, ACR, ACR-HR, DCR or CCR"
LONGEST_GAP = "longest time between two frames on the display, milliseconds; empty where not recorded"
FRAME_SHARE = "frames presented, of those that a film without drops presents in the time; empty where not recorded"
MISMATCH_SHARE = "share of the display's refreshes at which A and B were different frames; empty where not recorded"
SHOWN_SMOOTHLY = (
    "false if half of the frames were missing, none came for a second, or pictures came late; empty: unknown"
)
NOT_SMOOTH = "votes whose films were not shown smoothly; empty where that was not recorded"
FRAME_LOCKED = "false if A and B may have been a frame apart at times (two videos)"

VOTES: Columns = {
    "participant": PARTICIPANT,
    "dataset": DATASET,
    "item_a": "condition labelled A in this trial; in DCR the reference, in ACR the film itself",
    "item_b": "condition labelled B",
    "choice": CHOICE,
    "first_shown": "condition that was on screen first",
    "trial": "id of the trial",
    "response_ms": "from the voting screen to the vote, milliseconds",
    "practice": "true for practice",
    "excluded": "true if the vote does not count",
    "reason": "reason of the exclusion",
    "role": "main, or what the trial checks about the participant",
    "technique": TECHNIQUE,
    "frame_locked": FRAME_LOCKED,
    "both_seen": BOTH_SEEN,
    "looks_before": LOOKS_BEFORE,
    "press_to_picture_ms": PRESS_TO_PICTURE,
    "protocol": PROTOCOL,
    "rating": RATING,
    "reference": REFERENCE,
    "lighter_film": LIGHTER_FILM,
    "longest_gap_ms": LONGEST_GAP,
    "frame_share": FRAME_SHARE,
    "mismatch_share": MISMATCH_SHARE,
    "shown_smoothly": SHOWN_SMOOTHLY,
}
TRIALS: Columns = {
    "trial": "id of the trial",
    "session": "id of the session",
    "participant": PARTICIPANT,
    "number": "place in the participant's order, from 1",
    "attempt": "from 2 for repetitions of an interrupted trial",
    "looks_before": LOOKS_BEFORE,
    "dataset": DATASET,
    "item_a": "condition labelled A; in DCR the reference, in ACR the film itself",
    "item_b": "condition labelled B",
    "first_shown": "condition that was on screen first",
    "role": "main, or what the trial checks about the participant",
    "served_at": "when it was sent to the participant",
    "voided_at": "when it was interrupted",
    "void_reason": "full screen (was left), hidden, blur (other window in front), resize, suspended, or left the page",
    "voted_at": "when the vote arrived",
    "protocol": PROTOCOL,
    "choice": CHOICE,
    "rating": RATING,
    "reference": REFERENCE,
    "shown_ms": "how long the pair was shown, milliseconds",
    "response_ms": "from the voting screen to the vote, milliseconds",
    "n_switches": "switches between A and B",
    "both_seen": BOTH_SEEN,
    "press_to_picture_ms": PRESS_TO_PICTURE,
    "technique": TECHNIQUE,
    "frame_locked": FRAME_LOCKED,
    "lighter_film": LIGHTER_FILM,
    "n_mismatches": "display refreshes at which A and B were seen to be different frames",
    "longest_gap_ms": LONGEST_GAP,
    "frame_share": FRAME_SHARE,
    "mismatch_share": MISMATCH_SHARE,
    "shown_smoothly": SHOWN_SMOOTHLY,
    "viewing": "the whole viewing record, as JSON",
}
PARTICIPANTS: Columns = {
    "participant": PARTICIPANT,
    "session": "id of the session",
    "stage": "stage of the session",
    "n_trials": "trials planned",
    "n_votes": "votes given",
    "n_voided": "trials interrupted",
    "mean_response_ms": "mean response time, milliseconds",
    "started_at": "when the session began",
    "finished_at": "when it finished",
    "last_vote_at": "when the last vote arrived",
    "withdrawn_at": "when the participant withdrew",
    "group": "group that chance has assigned; empty where the study has none",
    "language": "language of all texts of the session; empty: begun by another client than the page",
    "texts_sha256": "SHA-256 of these texts, which are in the archive's texts.json",
    "erased_at": "when the participant's data were erased",
    "excluded": "true if excluded by an experimenter",
    "reason": "reason of the exclusion",
}
COUNTING: Columns = {
    "excluded": "true if what the participant gave does not count",
    "reason": "withdrawn, or the reason of the exclusion",
}
QUESTIONNAIRE: Columns = {
    "participant": PARTICIPANT,
    "question": "name of the question, or the spoken question itself",
    "answer": "the answer; empty if it was left out",
    "answered_at": "when the interview was completed, or the spoken answer noted",
    "source": "written by the participant, or spoken",
    "experimenter": "who noted a spoken answer",
    **COUNTING,
}
COMMENTS: Columns = {
    "participant": PARTICIPANT,
    "source": "written in the questionnaire, spoken in the interview, or noted on a trial",
    "question": "the question as it was asked, or the number of the trial with its dataset",
    "comment": "the comment",
    "tags": "tags that experimenters have given it, as a list",
    "written_at": "when it was given or noted",
    "experimenter": "who noted it; empty if the participant wrote it",
    "dataset": "dataset of the trial",
    "trial": "id of the trial",
    **COUNTING,
}
COMMENT_TAGS: Columns = {
    "tag": "name of the tag",
    "n_comments": "comments that bear it",
    "n_participants": "participants who gave these comments",
}
DEMOGRAPHICS: Columns = {
    "among": "counted: neither excluded nor withdrawn; everybody: the excluded, too",
    "question": "name of the question",
    "text": "the question as it was asked",
    "answer": "option, step of the scale, or left out; empty in the row that sums up a number or scale",
    "n": "participants who gave this answer, or any",
    "share": "their share of those who completed the questionnaire",
    "mean": "mean of a number or scale",
    "sd": "its standard deviation in the sample; empty for one participant",
    "minimum": "smallest answer",
    "maximum": "largest answer",
}
SCORES: Columns = {
    "comparison": "all conditions, or the levels of a factor",
    "dataset": "dataset, or all",
    "item": "condition, or level of the factor",
    "score": "natural log-odds; they sum to zero in each comparison and dataset",
    "se": "standard error from the observed information",
    "se_participant": "standard error clustered by participant",
    "ci_low": "lower end of the 95 % interval",
    "ci_high": "upper end",
    "n_votes": "votes on pairs with the item",
    "wins": "votes for the item",
    "losses": "votes for the other item",
    "ties": "votes without preference",
    "status": "ok, separated (no finite maximum) or disconnected",
    "jod": "score / ln 3: one JOD is preferred by 75 %",
    "jod_low": "lower end of its 95 % interval",
    "jod_high": "upper end",
    "jod_thurstone": "score of Thurstone's Case V in JOD; empty with an order effect or without a finite maximum",
    "jod_thurstone_low": "lower end of its 95 % interval",
    "jod_thurstone_high": "upper end",
    "preference_to_mean": "share of decided votes against a condition of the mean score",
    "preference_to_mean_low": "lower end of its 95 % interval",
    "preference_to_mean_high": "upper end",
    "ci_method": "what the interval rests on; empty where there is none",
    "win_probability": "probability of being preferred to another condition at random, given a preference",
    "penalty": "estimate that stands in for a maximum of separated votes; else empty",
    "letters": "conditions that share a letter are not told apart (all pairs, on single datasets of all of them; Holm)",
    "no_limit": "above or below where all decided votes go one way, so that the score has no limit there; else empty",
    "p_best": "probability to have the highest true score, by these votes alone",
    "rank_low": "first rank that the tests of pairs leave the condition; all such intervals hold together with 95 %",
    "rank_high": "last rank",
    "quasi_se": "error whose squares add up to that of any difference (quasi-variance)",
}
RATINGS: Columns = {
    "dataset": DATASET,
    "condition": "condition that was rated",
    "is_reference": "true for the study's reference",
    "n_ratings": "ratings",
    "n": "participants",
    "mos": "mean opinion score, on the study's scale",
    "sd": "standard deviation over participants",
    "ci_low": "lower end of the 95 % interval of the mean",
    "ci_high": "upper end",
    "dmos": "mean differential score to the reference",
    "dmos_sd": "its standard deviation over participants",
    "dmos_low": "lower end of its 95 % interval",
    "dmos_high": "upper end",
    "quality": "quality, the participants' bias and inconsistency taken off",
    "quality_se": "its standard error",
    "quality_low": "lower end of its 95 % interval",
    "quality_high": "upper end",
}
COMPARISONS: Columns = {
    "dataset": DATASET,
    "condition": "condition that was compared",
    "n_ratings": "ratings of pairs with it",
    "score": "how much better it is than the mean of all, in steps of the scale",
    "se": "its standard error, clustered by participant",
    "ci_low": "lower end of the 95 % interval",
    "ci_high": "upper end",
}
TRIADS: Columns = {
    "participant": PARTICIPANT,
    "dataset": DATASET,
    "n_items": "conditions compared",
    "complete": "true if every pair has a vote",
    "circular": "circular triads of strict preferences",
    "circular_expected_ties": "expected circular triads if ties were broken at random",
    "circular_max": "largest possible number of circular triads",
    "zeta": "coefficient of consistence, 1 - circular_expected_ties / circular_max",
    "p_value": "probability of as few circular triads under random votes on the same pairs, ties in the same places",
    "circular_by_chance": "expected circular triads under random votes",
    "strict_by_chance": "expected circular triads of strict preferences under random votes, ties in the same places",
}
OBSERVERS: Columns = {
    "participant": PARTICIPANT,
    "flags": "what is unusual about the votes; a reason to look, not to exclude",
}
OBSERVERS_OF_PAIRS: Columns = {
    "remarks": "what else is unusual; among honest people, too, somebody nearly always is",
    "careless_log_ratio": "natural logarithm of the likelihood ratio, careless to honest answers",
    "careless_false_alarms": "how many of so many honest people would be expected to look as careless",
    "careless_evidence": "what speaks for careless answers, in words",
    "n_votes": "votes that count",
    "one_side_unseen": "votes given although A or B was never on screen; empty where that was not recorded",
    "not_smooth": NOT_SMOOTH,
    "tie_rate": "share of votes without preference",
    "side_a_rate": "share of decided votes for A",
    "side_a_expected": "the same as everybody's scores explain it",
    "side_a_p_value": "p-value of their difference; exact up to 500 votes",
    "first_shown_rate": "share of decided votes for what was shown first",
    "first_shown_expected": "the same as everybody's scores explain it",
    "first_shown_p_value": "p-value of their difference; exact up to 500 votes",
    "repeated_pairs": "pairs judged more than once",
    "repeats_consistent": "those of them with the same answer each time",
    "median_response_ms": "median response time, milliseconds",
    "fastest_decile_ms": "response time that a tenth of the votes stay below, milliseconds",
    "median_press_to_picture_ms": "median over the votes of press_to_picture_ms; empty where not recorded",
    "circular": "circular triads over all datasets",
    "circular_p_value": "probability of as few circular triads under random votes",
    "loglik_per_vote_left_out": "log-likelihood per vote under scores fitted without the participant",
}
OBSERVERS_OF_RATINGS: Columns = {
    "n_ratings": "ratings",
    "mean": "mean rating",
    "bias": "how much higher than the others the participant rates",
    "bias_low": "lower end of its 95 % interval",
    "bias_high": "upper end",
    "inconsistency": "standard deviation of what quality and bias leave",
    "inconsistency_low": "lower end of its 95 % interval; empty where there is none",
    "inconsistency_high": "upper end",
    "correlation": "Pearson's, with the mean opinion scores of the same items",
    "bt500_above": "ratings far above the mean (ITU-R BT.500)",
    "bt500_below": "ratings far below the mean",
    "bt500_share": "share of ratings far from the mean",
    "bt500_imbalance": "how one-sided these are, 0 to 1; empty where there are none",
    "is_bt500_outlier": "true if ITU-R BT.500 names the participant",
    "is_correlation_low": "true if the correlation is below 0.75",
    "not_smooth": NOT_SMOOTH,
}
MEASUREMENTS: Columns = {
    "dataset": DATASET,
    "approach": "condition",
    "measure": "name of the objective measure",
    "value": "its value",
    "direction": "which way is better",
    "unit": "its unit",
    "better": "higher or lower: the direction in one word, as in tables of measures",
    "source": "what measured it",
    "attached_at": "when it was attached",
}
AUDIT: Columns = {
    "entry": "number of the entry",
    "at": "time",
    "actor": "who did it",
    "action": "what was done",
    "study": "study concerned",
    "subject": "object or person concerned",
    "detail": "more, as JSON",
}
JOBS: Columns = {
    "job": "id",
    "kind": "kind of job, as /api/v1/jobs/kinds lists them",
    "arguments": "value of each field of its form, as JSON",
    "output": "what it makes or changes, SHELF/NAME; sets are stimulus sets, the rest lies in the intake folder",
    "state": "queued, running, done, failed or cancelled",
    "is_cancelling": "true if it was cancelled and has not stopped yet",
    "step": "what is being done",
    "done": "how much of the step is done",
    "total": "how much the step is",
    "left_s": "estimate of what is left of the step, seconds; empty where there is none",
    "detail": "why it failed",
    "actor": "who queued it",
    "worker": "machine and process that runs it or ran it last",
    "attempt": "how often it was begun",
    "created_at": "time when it was queued",
    "started_at": "time when it was begun last; empty before",
    "ended_at": "time when it ended; empty before",
}
STUDIES: Columns = {
    "slug": "name in addresses",
    "name": "name",
    "state": "open, paused, closed or archived",
    "exposure_s": "how long a pair is shown, seconds",
    "created_at": "when it was created",
    "n_datasets": "datasets",
    "n_conditions": "conditions",
    "n_pairs": "pairs",
    "n_started": "participants who began",
    "n_finished": "participants who finished",
    "n_votes": "votes",
}
SCREENING: Columns = {
    "participant": PARTICIPANT,
    "session": "id of the session",
    "test": "what was tested",
    "verdict": "what the screening found; it is no diagnosis",
    "logmar": "acuity, logMAR",
    "low": "lower end of its 95 % interval",
    "high": "upper end",
    "limit": "limit that the study sets",
    "smallest": "smallest ring that the display can draw, logMAR",
    "pixel_mm": "pitch of the display's pixels, mm",
    "distance_mm": "distance of the eyes, mm",
    "distance_source": "how the distance was measured",
    "n_answered": "rings or plates answered",
    "started_at": "when the test began",
    "finished_at": "when it ended, or its result was entered",
    "is_bound": "is the acuity this or better, because the display draws no smaller rings?",
    "result_source": "screen: tested on the page; entered: by an experimenter, from a chart or another test",
    "instrument": "chart, plates or device of an entered result",
    "result": "entered result, as it was read",
    "experimenter": "who entered it",
    **COUNTING,
    "details": "more, as JSON",
}
FAILURES: Columns = {
    "participant": PARTICIPANT,
    "film": "what the film shows: dataset and conditions, or the practice",
    "trial": "id of the trial",
    "why": "what the browser says",
    "browser": "browser and system",
    "happened_at": "when it was told",
    "noted_at": "when an experimenter took note, or the study was opened again; empty: not yet",
}
SETS: Columns = {
    "name": "in addresses",
    "title": "name",
    "sha256": "digest of its manifest",
    "n_films": "films",
    "conditions": "names of its conditions, as JSON",
    "datasets": "names of its datasets, as JSON",
    "factors": "levels by factor, as JSON",
    "is_here": "true if it lies in the server's folder of stimulus sets",
    "studies": "names of the studies made of it, as JSON",
}
OUTSIDE_IDS: Columns = {
    "participant": PARTICIPANT,
    "outside_id": "id on the recruiting platform; empty: came without one",
    "state": "how far the participant is",
    "completion_code": "that the participant was given; empty before the end",
}
FIGURES: Columns = {"figure": "name in addresses", "caption": "what it shows"}
KINDS = {  # of columns that are no text: a Parquet file needs them for long tables, and where there are no values
    **dict.fromkeys((*OBSERVERS_OF_PAIRS, *OBSERVERS_OF_RATINGS), "float"),  # but those below
    **dict.fromkeys(("remarks", "careless_evidence"), "text"),
    **dict.fromkeys(("practice", "excluded", "frame_locked", "both_seen", "reference", "lighter_film"), "bool"),
    **dict.fromkeys(("shown_smoothly",), "bool"),
    **dict.fromkeys(
        ("is_reference", "complete", "is_bound", "is_cancelling", "is_here", "is_bt500_outlier", "is_correlation_low"),
        "bool",
    ),
    **dict.fromkeys(
        ("one_side_unseen", "not_smooth", "repeated_pairs", "repeats_consistent", "bt500_above", "bt500_below"), "int"
    ),
    **dict.fromkeys(("n_datasets", "n_conditions", "n_pairs", "n_started", "n_finished", "n_films"), "int"),
    **dict.fromkeys(("done", "total"), "int"),
    **dict.fromkeys(("looks_before", "rating", "number", "attempt", "n_switches", "n_mismatches", "entry"), "int"),
    **dict.fromkeys(("n_trials", "n_votes", "n_voided", "n_comments", "n_participants", "n_ratings", "n"), "int"),
    **dict.fromkeys(("wins", "losses", "ties", "n_items", "circular", "circular_max", "n_answered"), "int"),
    **dict.fromkeys(("response_ms", "press_to_picture_ms", "shown_ms", "mean_response_ms"), "float"),
    **dict.fromkeys(("longest_gap_ms", "frame_share", "mismatch_share"), "float"),
    **dict.fromkeys(("score", "se", "se_participant", "ci_low", "ci_high", "jod", "jod_low", "jod_high"), "float"),
    **dict.fromkeys(("jod_thurstone", "jod_thurstone_low", "jod_thurstone_high", "preference_to_mean"), "float"),
    **dict.fromkeys(("preference_to_mean_low", "preference_to_mean_high", "mos", "sd", "dmos", "dmos_sd"), "float"),
    **dict.fromkeys(("dmos_low", "dmos_high", "quality", "quality_se", "quality_low", "quality_high"), "float"),
    **dict.fromkeys(("circular_expected_ties", "zeta", "p_value", "circular_by_chance", "share", "mean"), "float"),
    **dict.fromkeys(("strict_by_chance", "p_best", "quasi_se"), "float"),
    **dict.fromkeys(("rank_low", "rank_high"), "int"),
    **dict.fromkeys(("minimum", "maximum", "value", "logmar", "low", "high", "limit", "smallest"), "float"),
    **dict.fromkeys(("pixel_mm", "distance_mm", "win_probability", "exposure_s", "left_s"), "float"),
    **dict.fromkeys(("served_at", "voided_at", "voted_at", "started_at", "finished_at"), "time"),
    **dict.fromkeys(("last_vote_at", "withdrawn_at", "erased_at", "at", "answered_at"), "time"),
    **dict.fromkeys(("written_at", "attached_at", "created_at", "ended_at", "happened_at", "noted_at"), "time"),
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
DOCUMENTED = {
    name
    for columns in (*TABLES.values(), *FURTHER.values(), STUDIES, JOBS, SETS, OUTSIDE_IDS, FIGURES)
    for name in columns
}


def with_others(columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return the documented columns of a table, then any others of its rows."""
    return list(dict.fromkeys([*columns, *(name for row in rows for name in row)]))
