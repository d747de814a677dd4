"""Say where people take part, and fill in how a recruiting platform sends them here, and how they go back to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from app.study.kinds import ONLINE, PAPER, QUICK
from app.study.options.recruiting import ENDINGS, LEFT_TO_FILL, OutsideOptions

# What platforms put in the place of a parameter's value when they send somebody; from their manuals.
FILLED_BY_PLATFORM: Mapping[str, str] = {
    "PROLIFIC_PID": "{{%PROLIFIC_PID%}}",
    "STUDY_ID": "{{%STUDY_ID%}}",
    "SESSION_ID": "{{%SESSION_ID%}}",
    "survey_code": "%SURVEY_CODE%",
    "RID": "[%RID%]",
}
MTURK_ID = "workerId"  # MTurk puts nothing into links; it gives the HIT's own page these parameters
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
    asks : what the platform shows you, by the YOUR-… that it is put in the place of, or by the option
    home : where people find the platform again who can neither finish nor give a code
    """

    title: str
    help: str
    outside: Mapping[str, Any] = field(default_factory=dict)
    asks: Mapping[str, str] = field(default_factory=dict)
    home: str = ""

    @property
    def needed(self) -> frozenset[str]:
        """Which answers the way back of who has finished needs."""
        return frozenset((*LEFT_TO_FILL.findall(self.outside.get("complete_url", "")), *(self.asks.keys() & {"code"})))

    def filled(self, answers: Mapping[str, str]) -> dict[str, Any]:
        """Return the options with answers in their places; an address that lacks one is empty.

        Raises
        ------
        ValueError
            If the address at the end of the study lacks one.
        """
        given = {name: text.strip() for name, text in answers.items() if name in self.asks and text.strip()}
        if missing := sorted(self.needed - given.keys()):
            raise ValueError(
                f"{self.title}: {self.asks[missing[0]]} is empty; put in what {self.title} shows you, as who has "
                "finished goes back with it"
            )
        filled = {**self.outside, **({"code": given["code"]} if "code" in given else {})}
        for ending in ENDINGS:
            if f"{ending}_url" in filled:
                filled[f"{ending}_url"] = _put_in(str(filled[f"{ending}_url"]), given)
        if not filled.get("failed_url") and not filled.get("no_consent_url") and self.home:
            filled["failed_url"] = _put_in(self.home, given)
        return filled


def _put_in(address: str, given: Mapping[str, str]) -> str:
    """Return an address with answers in their places; empty if it lacks one."""
    for name in LEFT_TO_FILL.findall(address):
        address = address.replace(name, given[name]) if name in given else ""
    return address


@dataclass(frozen=True)
class Way:
    """Where people take part, which chooses a preset and a platform."""

    title: str
    help: str
    preset: str
    platform: str = ""


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
        {
            "code": "Code of a completed study",
            "YOUR-SCREENED-OUT-CODE": "Code after screening out",
            "YOUR-NO-CONSENT-CODE": "Code without consent, or after withdrawing",
            "YOUR-TIMED-OUT-CODE": "Code when the time has run out",
            "YOUR-TECHNICAL-PROBLEM-CODE": "Code when a film cannot be shown",
        },
        "https://app.prolific.com/submissions",
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
        {
            "YOUR-SCHOOL": "School, as in SCHOOL.sona-systems.com",
            "YOUR-EXPERIMENT": "Number of the experiment",
            "YOUR-TOKEN": "Credit token",
        },
        "https://YOUR-SCHOOL.sona-systems.com/",
    ),
    "mturk": Platform(
        "MTurk",
        "workers paste a random code; the HIT's page gives the link their ids",
        {"id": MTURK_ID, "keep": ("assignmentId",), "random_codes": True},
        home="https://worker.mturk.com/tasks",
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
        {"YOUR-CINT-REDIRECT": "Redirect of your account, without https:// and without /?RIS"},
    ),
}
WAYS: Mapping[str, Way] = {  # in the order of the page; a way's name is that of its platform, if it has one
    "laboratory": Way("In the laboratory", "consent, screening, practice, questions; you invite people", PAPER),
    "home": Way("At home, by your link", "the same without spoken questions; you send the link", ONLINE),
    **{
        name: Way(platform.title, f"as at home; {platform.help}", ONLINE, name)
        for name, platform in PLATFORMS.items()
        if name
    },
    "quick": Way("Only a first look", "instructions and votes, nothing else", QUICK),
}


def link_path(code: str, outside: OutsideOptions) -> str:
    """Return an invitation's whole link without the server's address: "/s/CODE" and what `link_query` adds."""
    return f"/s/{code}{link_query(outside)}"


def link_query(outside: OutsideOptions) -> str:
    """Return what follows a study's link so that it says who comes, with the platform's placeholders; or nothing.

    Parameters of platforms that are not known here stand as NAME=[NAME], for the platform's own placeholder.
    """
    names = parameters(outside)
    parts = [f"{name}={FILLED_BY_PLATFORM.get(name, f'[{name}]')}" for name in names]
    return f"?{'&'.join(parts)}" if parts else ""


def parameters(outside: OutsideOptions) -> tuple[str, ...]:
    """Return the names of the parameters by which a link says who comes."""
    return (outside.id, *outside.keep) if outside.id else ()


def unknown_placeholders(outside: OutsideOptions) -> list[str]:
    """Return the parameters whose placeholder is not known here, so that a link shows NAME=[NAME]."""
    return [name for name in parameters(outside) if name not in FILLED_BY_PLATFORM]
