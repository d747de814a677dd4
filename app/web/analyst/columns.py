"""The columns of every table that analysts fetch, and what they mean: for answers, OpenAPI and the archive alike."""

from __future__ import annotations

Columns = dict[str, str]

PARTICIPANT = "label, by order of arrival"
DATASET = "dataset, that is a scene"
TECHNIQUE = "how A and B were kept in step: stacked, webcodecs or two videos; empty where the client did not tell"
FRAME_LOCKED = "false if A and B may have been a frame apart at times (two videos)"

VOTES: Columns = {
    "participant": PARTICIPANT,
    "dataset": DATASET,
    "item_a": "condition labelled A in this trial",
    "item_b": "condition labelled B",
    "choice": "a, b or none",
    "first_shown": "condition that was on screen first",
    "trial": "id of the trial",
    "response_ms": "from the voting screen to the vote, milliseconds",
    "practice": "true for practice",
    "excluded": "true if the vote does not count",
    "reason": "why it does not",
    "role": "main, or what the trial checks about the participant",
    "technique": TECHNIQUE,
    "frame_locked": FRAME_LOCKED,
}
TRIALS: Columns = {
    "trial": "id of the trial",
    "session": "id of the session",
    "participant": PARTICIPANT,
    "number": "place in the participant's order, from 1",
    "attempt": "2 for the repetition of an interrupted trial",
    "dataset": DATASET,
    "item_a": "condition labelled A",
    "item_b": "condition labelled B",
    "first_shown": "condition that was on screen first",
    "role": "main, or what the trial checks about the participant",
    "served_at": "when it was given out",
    "voided_at": "when it was interrupted",
    "void_reason": "by what",
    "voted_at": "when the vote came",
    "choice": "a, b or none",
    "shown_ms": "how long the pair was shown, milliseconds",
    "response_ms": "from the voting screen to the vote, milliseconds",
    "n_switches": "switches between A and B",
    "both_seen": "true if A and B were both on screen",
    "technique": TECHNIQUE,
    "frame_locked": FRAME_LOCKED,
    "n_mismatches": "display refreshes at which A and B were seen to be different frames",
    "viewing": "the whole viewing record, as JSON",
}
PARTICIPANTS: Columns = {
    "participant": PARTICIPANT,
    "session": "id of the session",
    "stage": "where the session is",
    "n_trials": "trials planned",
    "n_votes": "votes given",
    "n_voided": "trials interrupted",
    "mean_response_ms": "mean response time, milliseconds",
    "started_at": "when the session began",
    "finished_at": "when it finished",
    "last_vote_at": "when the last vote came",
    "withdrawn_at": "when the participant withdrew",
    "erased_at": "when what they gave was erased",
    "excluded": "true if excluded by an experimenter",
    "reason": "why",
}
QUESTIONNAIRE: Columns = {
    "participant": PARTICIPANT,
    "question": "name of the question, or the spoken question itself",
    "answer": "the answer; empty if it was left out",
    "answered_at": "when the interview was completed, or the spoken answer noted",
    "source": "written by the participant, or spoken",
    "experimenter": "who noted a spoken answer",
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
    "n_votes": "votes in which the item took part",
    "wins": "won",
    "losses": "lost",
    "ties": "no preference",
    "status": "ok, separated (no finite maximum) or disconnected",
}
TRIADS: Columns = {
    "participant": PARTICIPANT,
    "dataset": DATASET,
    "n_items": "conditions compared",
    "complete": "true if every pair has a vote",
    "circular": "circular triads of strict preferences",
    "circular_expected_ties": "expected if ties were broken at random",
    "circular_max": "largest possible number",
    "zeta": "coefficient of consistence, 1 - circular / circular_max",
    "p_value": "probability of as few under random votes",
}
OBSERVERS: Columns = {
    "participant": PARTICIPANT,
    "flags": "what is unusual about the votes; a reason to look, not to exclude",
}
MEASUREMENTS: Columns = {
    "dataset": DATASET,
    "approach": "condition",
    "measure": "name of the objective measure",
    "value": "its value",
    "direction": "which way is better",
    "unit": "its unit",
    "attached_at": "when it was attached",
}
AUDIT: Columns = {
    "entry": "number of the entry",
    "at": "when",
    "actor": "who",
    "action": "did what",
    "study": "in which study",
    "subject": "to what or whom",
    "detail": "more, as JSON",
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
    "n_finished": "who finished",
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
    "limit": "what the study asks for",
    "smallest": "smallest ring that the display can draw, logMAR",
    "pixel_mm": "pitch of the display's pixels, mm",
    "distance_mm": "distance of the eyes, mm",
    "distance_source": "how the distance is known",
    "n_answered": "rings or plates answered",
    "started_at": "when it began",
    "finished_at": "when it ended",
    "details": "more, as JSON",
}
TABLES: dict[str, Columns] = {
    "votes": VOTES,
    "trials": TRIALS,
    "participants": PARTICIPANTS,
    "screening": SCREENING,
    "questionnaire": QUESTIONNAIRE,
    "scores": SCORES,
    "triads": TRIADS,
    "observers": OBSERVERS,
    "validation": MEASUREMENTS,
    "audit": AUDIT,
}
