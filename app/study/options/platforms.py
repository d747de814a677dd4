"""Fill in how people come from well-known recruiting platforms, and make the link that each platform is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from app.study.options.recruiting import OutsideOptions

# What platforms put in the place of a parameter's value when they send somebody; from their manuals.
FILLED_BY_PLATFORM: Mapping[str, str] = {
    "PROLIFIC_PID": "{{%PROLIFIC_PID%}}",
    "STUDY_ID": "{{%STUDY_ID%}}",
    "SESSION_ID": "{{%SESSION_ID%}}",
    "survey_code": "%SURVEY_CODE%",
    "RID": "[%RID%]",
}
PROLIFIC = "https://app.prolific.com/submissions/complete?cc="
CINT = "https://YOUR-CINT-REDIRECT/?RIS="


@dataclass(frozen=True)
class Platform:
    """A recruiting platform.

    Parameters
    ----------
    title : its name
    help : what is left to fill in
    outside : the options that it fills in; YOUR-… is left to fill in
    """

    title: str
    help: str
    outside: Mapping[str, Any] = field(default_factory=dict)


PLATFORMS: Mapping[str, Platform] = {
    "": Platform("nobody", "you invite people by links, codes or a list"),
    "prolific": Platform(
        "Prolific",
        "fill in the completion codes that Prolific shows",
        {
            "id": "PROLIFIC_PID",
            "keep": ("STUDY_ID", "SESSION_ID"),
            "complete_url": f"{PROLIFIC}{{code}}",
            "screened_out_url": f"{PROLIFIC}YOUR-SCREENED-OUT-CODE",
            "no_consent_url": f"{PROLIFIC}YOUR-NO-CONSENT-CODE",
            "withdrawn_url": f"{PROLIFIC}YOUR-NO-CONSENT-CODE",
            "timed_out_url": f"{PROLIFIC}YOUR-TIMED-OUT-CODE",
            "failed_url": f"{PROLIFIC}YOUR-TECHNICAL-PROBLEM-CODE",
        },
    ),
    "sona": Platform(
        "SONA",
        "fill in your school, the experiment and its token",
        {
            "id": "survey_code",
            "resume": "same browser",
            "complete_url": "https://YOUR-SCHOOL.sona-systems.com/webstudy_credit.aspx?experiment_id=YOUR-EXPERIMENT"
            "&credit_token=YOUR-TOKEN&survey_code={id}",
        },
    ),
    "mturk": Platform(
        "MTurk",
        "workers paste a random code; the HIT's page gives the link their ids",
        {"id": "workerId", "keep": ("assignmentId",), "random_codes": True},
    ),
    "cint": Platform(
        "Cint",
        "fill in the redirect of your account",
        {
            "id": "RID",
            "complete_url": f"{CINT}10&RID={{id}}",
            "screened_out_url": f"{CINT}20&RID={{id}}",
            "no_consent_url": f"{CINT}20&RID={{id}}",
            "timed_out_url": f"{CINT}20&RID={{id}}",
            "failed_url": f"{CINT}20&RID={{id}}",
            "full_url": f"{CINT}40&RID={{id}}",
        },
    ),
}


def link_query(outside: OutsideOptions) -> str:
    """Return what follows a study's link so that it says who comes, with the platform's placeholders; or nothing.

    Parameters of platforms that are not known here stand as NAME=[NAME], for the platform's own placeholder.
    """
    names = (outside.id, *outside.keep) if outside.id else ()
    parts = [f"{name}={FILLED_BY_PLATFORM.get(name, f'[{name}]')}" for name in names]
    return f"?{'&'.join(parts)}" if parts else ""
