"""Examples for every body and response of the session interface, by schema; those of tables stand in `columns`.

`tests/app/web/analyst/test_openapi_examples.py` checks each against its schema.
"""

from __future__ import annotations

from typing import Any

from app.web.analyst import columns
from app.web.analyst.columns import VIEWING

PROGRESS = {"done": 12, "total": 90}
SESSION: dict[str, Any] = {
    "session": "3n8v5k2d9x7q",
    "study": {"slug": "temple", "title": "Temple", "exposure_s": 15.0},
    "stage": "trial",
    "stages": ["introduction", "screening", "practice", "trial", "interview", "finished"],
    "progress": PROGRESS,
    "minutes": {"introduction": 2.2, "screening": 5.1, "practice": 1.2, "trial": 33.8, "interview": 4.2},
    "language": "en",
    "was_away_long": False,
    "resume_code": "k7m2p9xq4wva",
    "stopped": False,
    "debriefing": None,
    "ending": None,
    "debriefing_html": None,
}
DRAFT: dict[str, Any] = {
    "preset": "online",
    "platform": "prolific",
    "answers": {"prolific.code": "C1A2B3C4"},
    "typed": {"name": "Street", "break_every": 15},
}
KEPT_DRAFT: dict[str, Any] = {**DRAFT, "stimulus_set": "street", "changed_at": "2027-03-01T12:00:00Z"}
TRIAL: dict[str, Any] = {
    "trial": "9f2m4c7w1z5t",
    "attempt": 1,
    "number": 13,
    "place": 13,
    "total": 90,
    "is_practice": False,
    "exposure_s": 15.0,
    "free_exposure": False,
    "see_both": True,
    "minimum_viewing_s": 0.0,
    "longest_gap_ms": 1040.0,
    "protocol": "PC",
    "grades": None,
    "void_on": ["full screen", "hidden"],
    "full_screen": "asked",
    "minimum_window": [],
    "first_shown": "b",
    "media": {
        "url": "/media/4h8s2p6y0r3j",
        "second": None,
        "lighter": None,
        "singles": None,
        "layout": "stacked",
        "a": "bottom",
        "width": 1920,
        "height": 1080,
        "guard_rows": 16,
        "reference": False,
        "fps": 25.0,
        "n_frames": 375,
        "pixels": "fit",
    },
}
VOTE_ID = "019aad55-2c00-7f5e-9a51-0c6b7f3d2e18"
JOB = columns.example_row(columns.JOBS)
JOB_KINDS: dict[str, Any] = {
    "kinds": [
        {
            "kind": "check",
            "title": "Check a capture",
            "help": "Lists everything that is wrong with a recording, with pictures of each sensor.",
            "fields": [
                {
                    "field": "capture",
                    "type": "Entry",
                    "label": "Capture",
                    "help": "recording in the capture format",
                    "required": True,
                    "default": None,
                    "choices": ["ball"],
                }
            ],
        }
    ]
}
EXAMPLES: dict[str, Any] = {
    "JobBody": {"kind": "reconstruct", "arguments": {"capture": "ball"}},
    "TurnedAwayBody": {"invitation": "k7m2p9xq4wva", "why": "phone"},
    "AdmissionBody": {"invitation": "k7m2p9xq4wva", "key": "0d9e6c1f-2a47-4c1b-8f53-7b2e9a4d6c10"},
    "Resumption": {"resume_code": "k7m2-p9xq-4wva", "key": "c41a8e07-5b3d-4d92-9f6a-1e7d2c8b4a55"},
    "SessionView": SESSION,
    "OpenedSessionView": {**SESSION, "token": "ZH3q0yWcP2v8eN5kR7tB1mXu"},
    "AskedView": {
        "consent": {"version": "2026-03", "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"},
        "comprehension": True,
        "practice": 2,
        "protocol": "PC",
        "questions": [{"name": "age", "kind": "number", "minimum": 16, "maximum": 120, "required": False}],
    },
    "ComprehensionBody": {"answer": "wait"},
    "ComprehensionView": {"understood": True},
    "ErasureBody": {"confirmed": True},
    "StageData": {"data": {"answers": {"age": 34, "sex": "female"}}},
    "ScreeningView": {
        "tests": [
            {"test": "acuity", "has_begun": True, "is_over": True, "n_answered": 24},
            {"test": "colour", "has_begun": True, "is_over": False, "n_answered": 4},
        ],
        "distance": "typed",
        "fixed_distance_cm": None,
        "pixel_mm": 0.277,
        "certificate": {"can_certify": True, "distance_cm": 70.0, "needed_distance_cm": 61},
        "seat_cm": 60.0,
    },
    "CardBody": {"card_widths": [323.5, 324.0], "device_pixel_ratio": 1.0, "window_height": 969},
    "DistanceBody": {"typed_cm": 70.0},
    "ItemView": {
        "test": "acuity",
        "number": 7,
        "total": 24,
        "picture": "/api/v1/session/screening/acuity/7.png",
        "size": 0.2,
        "choices": [0, 1, 2, 3, 4, 5, 6, 7],
        "may_be_nothing": True,
    },
    "SkipBody": {"reason": "no bank card at hand"},
    "AnswerBody": {"answer": 3, "response_ms": 1204.0},
    "MediaView": TRIAL["media"],
    "OneTrialView": TRIAL,
    "TrialView": {**TRIAL, "next_media": "/media/7d1k5n9b3g6f", "following": None},
    "VoteBody": {"id": VOTE_ID, "choice": "a", "viewing": VIEWING},
    "VoteView": {
        "id": VOTE_ID,
        "trial": "9f2m4c7w1z5t",
        "number": 13,
        "choice": "a",
        "rating": None,
        "received_at": "2026-03-01T12:04:31.512000+00:00",
    },
    "TroubleBody": {"why": "PIPELINE_ERROR_DECODE: the film cannot be decoded"},
    "VoidBody": {"reason": "hidden", "viewing": VIEWING},
}
STUDY_ROW = columns.example_row(columns.STUDIES)
STUDY_VIEW: dict[str, Any] = {
    **STUDY_ROW,
    "state": "paused",
    "n_started": 0,
    "n_finished": 0,
    "n_votes": 0,
    "revision": 1,
    "seed": 4711,
    "options": {"break_every": 25},
}
EXAMPLES |= {
    "DraftBody": DRAFT,
    "DraftView": KEPT_DRAFT,
    "WholeDraftView": {
        **KEPT_DRAFT,
        "hindrance": "",
        "study": {"name": "Street", "exposure_s": None, "seed": None, "options": {"break_every": 15}},
        "n_pairs": 6,
        "n_trials": 10,
        "n_films": 20,
        "n_bytes": 6.1e6,
        "seconds": 11.4,
        "minutes": {"introduction": 2.5, "trial": 1.2},
    },
    "TaskView": {
        "task": "3n8v5k2d9x7q",
        "state": "running",
        "done": 12,
        "total": 45,
        "detail": "encoding ball/approach_1 above ball/approach_2",
        "is_cancelled": False,
        "study": None,
        "stimulus_set": None,
        "file": None,
    },
    "NewUpload": {"kind": "captures", "name": "ball", "file": "ball.zip", "size": 734003200, "modified": 0},
    "UploadView": {"upload": "/api/v1/uploads/9f86d081884c7d659a2feaa0c55ad015", "offset": 0, "size": 734003200},
    "AttachBody": {"study": "temple"},
    "TagBody": {"tag": "faces and hair"},
    "NoteBody": {"comment": "said that both looked waxy"},
    "SetBody": {"name": "Temple, first light", "levels": {"approach_1": {"light": "side"}}},
    "TextsBody": {"revision": 4, "texts": {"study.consent": "I take part of my own free will."}},
    "LabelBody": {"label": "Ada Example <ada@example.org>"},
    "InterviewBody": {"answers": {"What did you look at?": "Mostly the faces."}},
    "EnteredBody": {
        "test": "acuity",
        "instrument": "Landolt C chart at 4 m",
        "result": "0.1 logMAR, both eyes",
        "verdict": "passed",
        "logmar": 0.1,
    },
    "CodeView": {"participant": "P007", "code": "k7m2p9xq4wva"},
    "NewStudyBody": {
        "name": "Temple",
        "stimulus_set": "temple",
        "preset": "paper",
        "options": {"break_every": 30},
        "exposure_s": 15.0,
        "seed": 4711,
    },
    "EditBody": {"revision": 1, "name": "Temple, second round", "options": {"break_every": 20}},
    "StateBody": {"state": "open"},
    "CopyBody": {"name": "Temple, again"},
    "ManagedStudyView": STUDY_VIEW,
    "InvitationsBody": {"places": 1, "number": 20, "label": ""},
    "InvitationView": {
        "code": "k7m2p9xq4wva",
        "places": 1,
        "n_used": 0,
        "path": "/s/k7m2p9xq4wva",
        "link": "https://study.example.org/s/k7m2p9xq4wva",
        "label": "",
    },
    "ExclusionBody": {"reason": "looked away from the screen"},
    "ExclusionView": {
        "participant": "P007",
        "reason": "looked away from the screen",
        "excluded_by": "token lab",
        "excluded_at": "2026-03-02T09:00:00+00:00",
    },
}
SET = columns.example_row(columns.SETS)
STIMULUS_SET: dict[str, Any] = {
    **SET,
    "levels": {"approach_1": {"light": "front"}, "approach_2": {"light": "side"}},
    "stimuli": [
        {
            "dataset": "ball",
            "approach": "approach_1",
            "video": "ball/approach_1.mp4",
            "sha256": SET["sha256"],
            "width": 1920,
            "height": 1080,
            "fps": 25.0,
            "n_frames": 375,
            "codec": "h264",
            "model_bytes": None,
            "renderer": "",
        }
    ],
}
FILM_CHECK: dict[str, Any] = {
    "checked_at": "2026-03-02T09:00:00+00:00",
    "films": SET["sha256"],
    "n_films": 90,
    "n_played": 90,
    "browser": "Chromium 140",
    "faults": {},
}
READ_VOTES: dict[str, Any] = {
    "holds": "votes",
    "columns": [{"column": "judge", "role": "participant"}, {"column": "age", "role": ""}],
    "lists": ["votes.csv: text in UTF-8, commas between cells; 36 rows, 36 votes; not used: age"],
    "warnings": [],
    "analysis": {"scores": []},
}
FILE: dict[str, Any] = {
    **columns.example_row(columns.FILES),
    "files": {"capture.json": 812, "S1/left/0001.png": 2407322},
}
EVERYTHING: dict[str, Any] = {"study": "temple", "label": "P007", "session": [{"stage": "finished"}], "vote": []}
TEXTS: dict[str, Any] = {
    "revision": 4,
    "first_language": "en",
    "languages": {"en": "offered", "de": "the study's consent is missing"},
    "texts": {"en": {"study.consent": "I take part of my own free will."}},
    "images": {"room.png": SET["sha256"]},
}
DESIGN: dict[str, Any] = {
    "conditions": {"approach_1": {"light": "front"}, "approach_2": {"light": "side"}},
    "factors": {"light": ["front", "side"]},
    "pairs": [{"dataset": "ball", "top": "approach_1", "bottom": "approach_2"}],
    "n_trials": 90,
    "minutes": {"introduction": 2.2, "trial": 33.8},
    "balance": None,
}
PLAN: dict[str, Any] = {
    "conditions": 6,
    "datasets": 6,
    "participants": 22,
    "effect": 0.5,
    "claim": "told apart",
    "spread": 0.4,
    "tie_rate": 0.2,
    "by_dataset": 0.0,
    "dataset_spread": 0.0,
    "drop_out": 0.0,
    "careless": 0.0,
    "replicates": 200,
    "is_rated": False,
    "power": {"one_dataset": 0.42, "all_datasets": 0.97},
    "detectable": {"one_dataset": 0.85, "all_datasets": 0.38},
    "claims": [],
    "participants_wanted": None,
    "clickers_named": None,
}
STUDY = STUDY_ROW | {
    "datasets": ["ball", "box"],
    "conditions": [{"item": "approach_2", "levels": {"light": "side", "pose": "far"}}],
    "stimuli": [{"dataset": "ball", "item": "approach_2"}, {"dataset": "box", "item": "approach_2"}],
    "factors": {"light": ["front", "side", "back"], "pose": ["near", "far"]},
    "protocol": "PC",
    "scale": 5,
    "reference": "",
    "revision": 1,
    "lab_sheet": {"display": "ASUS VG278", "size_inch": 27.0, "white_point": "5000 K", "distance_cm": 90.0},
}
ANALYSIS = {
    "schema_version": 1,
    "scores": [
        {
            name: columns.SCORES[name].example
            for name in ["comparison", "dataset", "item", "score", "se", "ci_low", "ci_high", "status"]
        }
    ],
    "findings": [
        {"about": "best", "text": "approach_2 is best: it has the highest score, +1.08 (95 % interval +0.83 to …"}
    ],
    "warnings": ["a single participant voted, so nothing can be said about other people"],
}
