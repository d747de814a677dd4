"""Define all tables. A vote is inserted once and never updated; other rows are updated column by column."""

from __future__ import annotations

from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
    text,
)

from app.store.database.engine import UtcDateTime
from app.store.database.schema import digest, metadata, reference, required, table, unique_where
from app.store.database.steady_clock import running_s, this_start


def film() -> tuple[Column[Any], ...]:
    """Return the columns of a film that shows a pair."""
    return (
        required("media", String(32), unique=True),
        required("file", String(80)),
        digest("sha256"),
        required("width", Integer),
        required("height", Integer),
        required("guard_rows", Integer),
        required("fps", Float),
        required("n_frames", Integer),
    )


study = table(
    "study",
    required("slug", String(64), unique=True),
    required("name", String(200)),
    required("state", String(8)),
    required("exposure_s", Float),
    required("seed", BigInteger),
    required("factors", JSON),
    required("options", JSON, server_default="{}"),
    digest("manifest_sha256"),
    Column("set_folder", String(4000)),  # where its stimulus set lies, to make films again; NULL: not known
    required("created_at", UtcDateTime),
    Column("paused_at", UtcDateTime),  # NULL: it does not pause
    Column("closed_at", UtcDateTime),  # NULL: it is open
    Column("archived_at", UtcDateTime),  # NULL: it is not put away
    Column("forgotten_at", UtcDateTime),  # when its participants' personal data were deleted; NULL: not yet
    required("revision", Integer, server_default="1"),  # counts edits, so that two editors notice each other
    CheckConstraint("state in ('open', 'closed')", name="state"),
    CheckConstraint("exposure_s > 0", name="exposure"),
)

dataset = table(
    "dataset",
    reference("study", index=False),
    required("position", Integer),
    required("name", String(200)),
    UniqueConstraint("study_id", "name"),
)

condition = table(
    "condition",
    reference("study", index=False),
    required("position", Integer),
    required("name", String(200)),
    required("levels", JSON),
    UniqueConstraint("study_id", "name"),
)

stimulus = table(
    "stimulus",
    reference("dataset", index=False),
    reference("condition"),
    digest("sha256"),
    required("width", Integer),
    required("height", Integer),
    required("fps", Float),
    required("n_frames", Integer),
    required("codec", String(40)),
    required("renderer", String(200)),
    UniqueConstraint("dataset_id", "condition_id"),
)

pair = table(
    "pair",
    reference("dataset"),
    Column("top_id", ForeignKey("stimulus.id"), nullable=False),
    Column("bottom_id", ForeignKey("stimulus.id"), nullable=False),
    *film(),
    UniqueConstraint("top_id", "bottom_id"),
)

measurement = table(
    "measurement",
    reference("dataset", index=False),
    reference("condition"),
    required("measure", String(200)),
    required("value", Float),
    required("direction", String(20)),
    required("unit", String(40)),
    Column("source", String(500)),  # NULL: attached before sources were kept
    required("attached_at", UtcDateTime),
    UniqueConstraint("dataset_id", "condition_id", "measure"),
    CheckConstraint("direction in ('less is better', 'more is better')", name="direction"),
)

report = table(  # its files lie in the data folder, under their digest
    "report",
    reference("study", index=False),
    required("kind", String(20)),
    required("subject", String(500)),
    digest("digest"),
    required("attached_at", UtcDateTime),
    UniqueConstraint("study_id", "kind", "subject"),
)

model = table(  # the file lies in the data folder, under its digest
    "model",
    reference("dataset", index=False),
    reference("condition"),
    required("kind", String(5)),
    digest("sha256"),
    required("n_points", Integer),
    required("n_faces", Integer),
    Column("error_limit_mm", Float),  # NULL: the truth is not known
    required("attached_at", UtcDateTime),
    UniqueConstraint("dataset_id", "condition_id", "kind"),
    CheckConstraint("kind in ('mesh', 'cloud', 'splat')", name="kind"),
)

practice_pair = table(
    "practice_pair",
    reference("study", index=False),
    required("position", Integer),
    *film(),
    UniqueConstraint("study_id", "position"),
)

second_film = table(  # a pair's film in another codec, for browsers that do not play H.264
    "second_film",
    required("media", String(32), unique=True),
    required("of_media", String(32), unique=True),  # of the pair, to compare or to practise with
    required("codec", String(8)),
    required("file", String(80)),
    digest("sha256"),
)

single_film = table(  # a single strip of a pair's film, for browsers that play no film of both
    "single_film",
    required("of_media", String(32)),  # of the pair, to compare or to practise with
    required("strip", String(9)),
    required("file", String(80)),
    digest("sha256"),
    UniqueConstraint("of_media", "strip"),
    CheckConstraint("strip in ('top', 'bottom', 'reference')", name="strip"),
)

lighter_film = table(  # a pair's film with fewer bytes, for slow lines
    "lighter_film",
    required("of_media", String(32), unique=True),  # of the pair, to compare or to practise with
    required("file", String(80)),
    digest("sha256"),
)

invitation = table(
    "invitation",
    reference("study"),
    required("code", String(40), unique=True),
    Column("places", Integer),  # NULL: as many as come
    required("label", String(200), server_default=text("''")),  # whom it is for, in the experimenter's words
    required("created_at", UtcDateTime),
)

participant = table(
    "participant",
    reference("study", index=False),
    reference("invitation"),
    required("slot", Integer),  # counts arrivals; the label follows from it
    required("order_slot", Integer, server_default="0"),  # number of the order of trials: an abandoned one, or new
    Column("released_at", UtcDateTime),  # when somebody else got this order; NULL: not yet
    required("label", String(40)),
    Column("group_name", String(60)),  # that chance assigned; NULL: the study has no groups
    required("created_at", UtcDateTime),
    required("is_preview", Boolean, server_default=false()),  # an experimenter's walk through; it counts nowhere
    Column("erased_at", UtcDateTime),  # NULL: what was given is still there
    UniqueConstraint("study_id", "slot"),
    UniqueConstraint("study_id", "label"),
)

unique_where(
    "uq_participant_held_order",
    participant.c.study_id,
    participant.c.order_slot,
    where=participant.c.released_at.is_(None),
)

recruit = table(  # how a participant came from a recruiting platform; in no table of scores or votes
    "recruit",
    reference("study", index=False),
    reference("participant", index=False),
    Column("outside_id", String(100)),  # NULL: the study takes people without an id
    required("kept", JSON),
    required("completion_code", String(40)),  # empty: the study's own, or none
    UniqueConstraint("participant_id"),
    UniqueConstraint("study_id", "outside_id"),
)

session = table(
    "session",
    required("public_id", String(32), unique=True),
    reference("participant"),
    digest("token_hash", unique=True),
    digest("resume_hash", unique=True),
    Column("begin_hash", String(64), unique=True, index=True),  # of the key that the client made; NULL: it made none
    required("stage", String(40)),
    required("started_at", UtcDateTime),
    Column("machine_start", String(36), default=this_start),  # in which it began; NULL: not known
    Column("running_s", Float, default=running_s),  # when it began, by the clock of that start
    Column("finished_at", UtcDateTime),
    Column("withdrawn_at", UtcDateTime),
    Column("language", String(40)),  # of its texts, chosen once; NULL: begun by another client than the page
    Column("texts_sha256", String(64)),  # of `shown_texts`
)

study_image = table(  # shown in consent and debriefing
    "study_image",
    reference("study", index=False),
    required("name", String(80)),
    digest("sha256", index=True),
    required("content", LargeBinary),
    UniqueConstraint("study_id", "name"),
)

shown_texts = Table(  # all texts that participants have read, by their digest: a pack's file may change later
    "shown_texts",
    metadata,
    Column("sha256", String(64), primary_key=True),
    required("language", String(40)),
    required("content", JSON),
)

stage_record = table(
    "stage_record",
    reference("session", index=False),
    required("stage", String(40)),
    required("data", JSON),
    required("completed_at", UtcDateTime),
    UniqueConstraint("session_id", "stage"),
)

screening_display = table(
    "screening_display",
    reference("session", index=False),
    required("pixel_mm", Float),
    Column("distance_mm", Float),  # NULL: not yet known
    Column("distance_source", String(12)),
    required("height_px", Integer),
    required("measured", JSON),  # as the browser sent it
    required("measured_at", UtcDateTime),
    UniqueConstraint("session_id"),
    CheckConstraint("pixel_mm > 0", name="pixel_mm"),
)

screening_test = table(
    "screening_test",
    reference("session", index=False),
    required("test", String(12)),
    required("setup", JSON),
    required("started_at", UtcDateTime),
    Column("finished_at", UtcDateTime),  # NULL: it runs
    Column("verdict", String(24)),
    Column("result", JSON(none_as_null=True)),
    UniqueConstraint("session_id", "test"),
    CheckConstraint("test in ('acuity', 'colour')", name="test"),
)

screening_item = table(
    "screening_item",
    reference("session"),
    reference("screening_test", index=False),
    required("number", Integer),
    required("content", JSON),  # the right answer is stored here alone
    required("served_at", UtcDateTime),
    Column("answer", Integer),
    Column("answered_at", UtcDateTime),  # NULL: not yet
    Column("response_ms", Float),
    UniqueConstraint("screening_test_id", "number"),
)

screening_entry = table(  # results of tests beside the screen; the newest of a test counts, none is changed
    "screening_entry",
    reference("session"),
    required("test", String(12)),
    required("instrument", String(200)),
    required("result", String(200)),
    required("verdict", String(24)),
    Column("logmar", Float),  # NULL: not of acuity, or read on another scale
    required("experimenter", String(120)),
    required("entered_at", UtcDateTime),
    CheckConstraint("test in ('acuity', 'colour')", name="test"),
)

spoken_answer = table(
    "spoken_answer",
    reference("session", index=False),
    required("question", String(500)),  # as it was asked
    required("answer", Text),
    required("experimenter", String(120)),
    required("written_at", UtcDateTime),
    UniqueConstraint("session_id", "question"),
)

trial_comment = table(  # what was said or seen at a trial, as an experimenter notes it
    "trial_comment",
    reference("session"),
    reference("trial", index=False),
    required("comment", Text),
    required("experimenter", String(120)),
    required("written_at", UtcDateTime),
    UniqueConstraint("trial_id"),
)

comment_tag = table(  # of an experimenter's coding scheme
    "comment_tag",
    reference("study", index=False),
    required("name", String(60)),
    required("created_at", UtcDateTime),
    UniqueConstraint("study_id", "name"),
)

comment_tagging = table(
    "comment_tagging",
    reference("session", index=False),
    reference("comment_tag"),
    required("source", String(8)),
    required("subject", String(500)),  # name of the question, the spoken question, or id of the trial
    required("tagged_by", String(120)),
    required("tagged_at", UtcDateTime),
    UniqueConstraint("session_id", "source", "subject", "comment_tag_id"),
    CheckConstraint("source in ('written', 'spoken', 'trial')", name="source"),
)

assignment = table(
    "assignment",
    reference("participant", index=False),
    required("position", Integer),
    reference("pair"),
    required("a_half", String(6)),
    required("first_shown", String(1)),
    required("role", String(9), server_default="main"),
    UniqueConstraint("participant_id", "position"),
    CheckConstraint("a_half in ('top', 'bottom')", name="a_half"),
    CheckConstraint("first_shown in ('a', 'b')", name="first_shown"),
    CheckConstraint("role in ('main', 'repeat', 'identical')", name="role"),
)

trial = table(
    "trial",
    required("public_id", String(32), unique=True),
    reference("session", index=False),
    reference("assignment"),
    required("attempt", Integer),
    Column("served_at", UtcDateTime),  # NULL: not yet reached
    Column("voided_at", UtcDateTime, index=True),  # NULL: it counts
    Column("void_reason", String(20)),
    Column("void_viewing", JSON(none_as_null=True)),
    UniqueConstraint("session_id", "assignment_id", "attempt"),
    Index("uq_trial_session_id_id", "session_id", "id", unique=True),
    Index("ix_trial_session_id_served_at", "session_id", "served_at", "voided_at"),  # to count a study's at once
)

vote = table(
    "vote",
    required("client_id", String(36), unique=True),
    reference("session", index=False),
    required("trial_id", Integer),
    Column("choice", String(4)),  # NULL: the protocol asks for a rating alone
    Column("rating", Integer),  # NULL: of a choice; of B, or of B compared with A
    required("first_shown", String(1)),
    required("n_switches", Integer),
    required("shown_ms", Float),
    required("response_ms", Float),
    required("viewing", JSON),
    required("received_at", UtcDateTime, index=True),
    Column("both_seen", Boolean),  # of the viewing record; NULL: one film alone
    Column("press_to_picture_ms", Float),  # of the viewing record; NULL: it does not tell
    Column("shown_smoothly", Boolean),  # of the viewing record; NULL: it does not tell
    UniqueConstraint("session_id", "trial_id"),
    ForeignKeyConstraint(["session_id", "trial_id"], ["trial.session_id", "trial.id"]),  # by one index for both columns
    # without `in`: SQLite builds a table of three values and more for every row that it checks
    CheckConstraint("choice = 'a' or choice = 'b' or choice = 'none'", name="choice"),
    CheckConstraint("choice is not null or rating is not null", name="answer"),
    CheckConstraint("first_shown in ('a', 'b')", name="first_shown"),
)

film_failure = table(  # a film that a participant's browser could not show
    "film_failure",
    reference("session"),
    required("media", String(32)),  # of the pair, to compare or to practise with
    required("trial", String(40)),
    required("reason", String(300)),  # as the browser says it
    required("browser", String(80)),
    required("happened_at", UtcDateTime, index=True),
    Column("settled_at", UtcDateTime),  # when somebody took note; NULL: nobody has, and it is an alarm
)

exclusion = table(
    "exclusion",
    reference("participant"),
    required("reason", String(500)),
    required("excluded_by", String(120)),
    required("excluded_at", UtcDateTime),
    Column("undone_by", String(120)),
    Column("undone_at", UtcDateTime),  # NULL: it holds
)

unique_where("uq_exclusion_in_force", exclusion.c.participant_id, where=exclusion.c.undone_at.is_(None))

experimenter = table(
    "experimenter",
    required("name", String(100), unique=True),
    required("role", String(12), server_default="owner"),
    Column("studies", JSON(none_as_null=True)),  # slugs of those to see; NULL: all
    Column("password_hash", String(200)),  # NULL: none chosen yet
    digest("link_hash", unique=True),
    Column("link_expires_at", UtcDateTime),  # NULL: the link is of no use
    Column("totp_secret", String(64)),  # NULL: no second factor
    Column("totp_since", UtcDateTime),  # NULL: the second factor is being set up
    Column("totp_step", BigInteger),  # of the last code taken; none is taken twice
    Column("disabled_at", UtcDateTime),
    required("created_at", UtcDateTime),
)

experimenter_session = table(
    "experimenter_session",
    reference("experimenter"),
    digest("token_hash", unique=True),
    Column("previous_hash", String(64), index=True),  # of the previous token, valid for another minute
    required("created_at", UtcDateTime),
    Column("rotated_at", UtcDateTime),
    Column("seen_at", UtcDateTime),
    Column("form_token", String(64)),  # what every form of this session must carry
    Column("browser", String(60)),  # for the list of sessions, such as Firefox on Linux
    required("expires_at", UtcDateTime),
)

recovery_code = table(  # signs in once without the second factor; a code taken is deleted
    "recovery_code",
    reference("experimenter"),
    digest("code_hash"),
)

api_token = table(
    "api_token",
    required("name", String(100), unique=True),
    digest("token_hash", unique=True),
    required("scopes", JSON),
    Column("studies", JSON(none_as_null=True)),  # slugs of those it opens; NULL: all
    required("created_at", UtcDateTime),
    Column("created_by", String(120)),
    Column("expires_at", UtcDateTime),  # NULL: until it is revoked
    Column("revoked_at", UtcDateTime),
)

audit_entry = table(
    "audit_entry",
    required("at", UtcDateTime),
    required("actor", String(120)),
    required("action", String(60)),
    Column("study_id", ForeignKey("study.id"), index=True),  # NULL: of no study
    required("subject", String(200)),
    required("detail", JSON),
)

study_draft = table(  # the form of a study that is not created yet, as it was typed
    "study_draft",
    required("actor", String(120)),
    required("stimulus_set", String(200)),
    required("content", JSON),
    required("changed_at", UtcDateTime),
    UniqueConstraint("actor", "stimulus_set"),
)

task = table(  # what the server does in a thread of its own; called a job until there were jobs
    "job",
    required("public_id", String(32), unique=True),
    required("actor", String(120)),
    required("title", String(300)),
    Column("subject", String(200)),  # what it makes; NULL: nothing that another task could make
    required("state", String(8)),
    required("done", Integer),
    required("total", Integer),
    required("detail", String(500)),
    Column("result", String(200)),  # where to go when it is done
    required("started_at", UtcDateTime),
    required("beat_at", UtcDateTime),  # its last sign of life
    Column("work", JSON(none_as_null=True)),  # by which it is taken up after a restart; NULL: it is not
    Column("cancelled_at", UtcDateTime),  # NULL: it is not to stop
    CheckConstraint("state in ('running', 'done', 'failed')", name="state"),
)

unique_where("uq_job_running_subject", task.c.subject, where=task.c.state == "running")

queued_job = table(  # a command on recordings or films, which a worker process runs
    "queued_job",
    required("public_id", String(32), unique=True),
    required("actor", String(120)),
    required("kind", String(40)),
    required("arguments", JSON),
    required("output", String(200)),  # the entry of a shelf that it makes or changes, for example "runs/ball"
    required("state", String(9)),
    Column("worker", String(200)),  # the one that runs it, or ran it last; NULL: not begun
    required("attempt", Integer),  # counts beginnings
    required("is_cancelling", Boolean),  # asked to stop, and not stopped yet
    required("step", String(100)),  # what is being done
    required("done", Integer),
    required("total", Integer),
    Column("left_s", Float),  # of the step; NULL: no estimate
    required("detail", String(500)),  # why it failed
    required("created_at", UtcDateTime),
    Column("started_at", UtcDateTime),
    Column("ended_at", UtcDateTime),
    CheckConstraint("state in ('queued', 'running', 'done', 'failed', 'cancelled')", name="state"),
)

unique_where("uq_queued_job_output", queued_job.c.output, where=queued_job.c.state.in_(("queued", "running")))

worker = table(  # a process that runs queued jobs; its row goes when it ends
    "worker",
    required("name", String(200), unique=True),
    required("kinds", JSON),  # of jobs that it can run
    required("n_at_once", Integer),
    required("started_at", UtcDateTime),
    required("beat_at", UtcDateTime),  # its last sign of life
)
