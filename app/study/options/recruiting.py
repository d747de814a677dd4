"""Define how people come to a study from a recruiting platform, how they go back to it, and how many are taken in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import datetime, timedelta
from typing import Any, Literal

from app.study.options.entries import Entries, is_list

Resume = Literal["anywhere", "same browser"]
Ending = Literal["complete", "screened_out", "no_consent", "full"]

ENDINGS: tuple[Ending, ...] = ("complete", "screened_out", "no_consent", "full")
RESUMES: tuple[Resume, ...] = ("anywhere", "same browser")
PARAMETER = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,39}")  # the name of a URL's parameter
TAKEN_NAMES = ("another", "language", "code")  # parameters of our pages, and placeholders
VALUE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._~@:+=-]{0,99}")  # no placeholder left unfilled, and no formula in a table
CODE = re.compile(r"[A-Za-z0-9_-]{1,40}")
ADDRESS = re.compile(r"https://[A-Za-z0-9.-]+(:\d{1,5})?(/[!-~]*|\?[!-~]*)?")
PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
MOST_KEPT = 10
LONGEST_ADDRESS = 1000
LONGEST_WAIT_S = 600
REDIRECT_AFTER_S = 10  # long enough to read that the code is on the page and where the browser goes
MOST_PEOPLE = 1_000_000
LONGEST_MINUTES = 10_080  # a week


@dataclass(frozen=True)
class Arrival:
    """What a platform's link says of the person who follows it: the outside id, and the parameters to keep."""

    outside_id: str
    kept: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class OutsideOptions:
    """How participants come from a recruiting platform, and how they go back.

    Parameters
    ----------
    id : name of the link's parameter that holds the platform's id of a person; empty: people come without an id
    keep : names of further parameters to keep
    resume : "anywhere": who comes with a known id goes on with its session; "same browser": only where it began
    code : the completion code of everybody; empty: none
    random_codes : does each participant get a random completion code?
    complete_url, screened_out_url, no_consent_url, full_url : https address to go to at the end, after screening out,
        without consent, or when nobody more is taken in; `{id}`, `{code}` and kept names stand for their values; empty:
        none
    redirect_after_s : seconds after which the browser goes there by itself; 0: only by the button
    """

    id: str = ""
    keep: tuple[str, ...] = ()
    resume: Resume = "anywhere"
    code: str = ""
    random_codes: bool = False
    complete_url: str = ""
    screened_out_url: str = ""
    no_consent_url: str = ""
    full_url: str = ""
    redirect_after_s: int = REDIRECT_AFTER_S

    @property
    def is_on(self) -> bool:
        """Is anything kept of a participant's way from and to a platform?"""
        return bool(self.id) or self.random_codes

    @property
    def without_codes(self) -> OutsideOptions:
        """The same without what a platform pays for: the completion code, and the addresses that lead back."""
        return replace(self, code="", complete_url="", screened_out_url="", no_consent_url="", full_url="")

    def url(self, ending: Ending) -> str:
        """Return the address of an ending, with its placeholders; empty: none."""
        return str(getattr(self, f"{ending}_url"))

    def address(self, ending: Ending, arrival: Arrival | None, code: str = "") -> str:
        """Return the address to send a person to, its placeholders replaced; empty: none.

        Parameters
        ----------
        ending : how the study ended
        arrival : how the person came; None: without an id
        code : the completion code, only for who has completed the study
        """
        values = {"id": arrival.outside_id, **arrival.kept} if arrival else {}
        values |= {"code": code}
        return PLACEHOLDER.sub(lambda place: _encoded(values.get(place[1], "")), self.url(ending))

    def arrival(self, parameters: Mapping[str, str]) -> Arrival | None:
        """Read what a link says of the person who follows it; None where the study takes people without an id.

        Parameters
        ----------
        parameters : of the link, by name; others than the study's are left aside

        Raises
        ------
        ValueError
            If the id is missing, or a value has other characters than ids have.
        """
        if not self.id:
            return None
        given = {name: parameters[name] for name in (self.id, *self.keep) if name in parameters}
        if self.id not in given:
            raise ValueError(f"the link has no {self.id}, by which the platform says who comes")
        for name, value in given.items():
            if not VALUE.fullmatch(value):
                raise ValueError(
                    f"{name} is not 1 to 100 letters, digits or . _ ~ @ : + = -, the first a letter, digit or _"
                )
        return Arrival(given.pop(self.id), given)


@dataclass(frozen=True)
class LimitOptions:
    """How many are taken in, until when, and how long each may take.

    Parameters
    ----------
    finished : most who finish; those under way count, because they may finish; 0: any number
    under_way : most at the same time; 0: any number
    open_until : date and time with its zone after which nobody new is taken in, ISO 8601; empty: no end
    minutes : that a participant has from the beginning to the last vote; 0: any time
    """

    finished: int = 0
    under_way: int = 0
    open_until: str = ""
    minutes: int = 0

    def is_over(self, now: datetime) -> bool:
        """Is the last moment to begin past?"""
        return bool(self.open_until) and now >= datetime.fromisoformat(self.open_until)

    def is_full(self, n_finished: int, n_under_way: int) -> bool:
        """Is nobody more to be taken in while so many have finished and so many are under way?"""
        is_finished = bool(self.finished) and n_finished + n_under_way >= self.finished
        return is_finished or (bool(self.under_way) and n_under_way >= self.under_way)

    def begun_before(self, now: datetime) -> datetime | None:
        """Return when the participants began whose time is over now; None: it never is."""
        return now - timedelta(minutes=self.minutes) if self.minutes else None


def _encoded(value: str) -> str:
    """Percent-encode what is not unreserved in a URL; the values are ASCII."""
    return re.sub(r"[^A-Za-z0-9._~-]", lambda sign: f"%{ord(sign[0]):02X}", value)


def parse_outside(content: Any) -> OutsideOptions:
    """Read the table [options.outside] of a study file.

    Raises
    ------
    ValueError
        Naming the key, the value and what is expected.
    """
    entries = Entries.of_table(content, "outside", [field.name for field in fields(OutsideOptions)])
    options = OutsideOptions(
        id=entries.match("id", PARAMETER, "the name of a parameter such as PROLIFIC_PID"),
        keep=_kept(entries),
        resume=entries.one_of("resume", RESUMES, RESUMES[0]),
        code=entries.match("code", CODE, "1 to 40 letters, digits, - or _"),
        random_codes=entries.flag("random_codes"),
        **{f"{ending}_url": _address(entries, f"{ending}_url") for ending in ENDINGS},
        redirect_after_s=entries.count("redirect_after_s", LONGEST_WAIT_S, REDIRECT_AFTER_S),
    )
    _check_together(options)
    return options


def parse_limits(content: Any) -> LimitOptions:
    """Read the table [options.limits] of a study file.

    Raises
    ------
    ValueError
        Naming the key, the value and what is expected.
    """
    entries = Entries.of_table(content, "limits", [field.name for field in fields(LimitOptions)])
    return LimitOptions(
        finished=entries.count("finished", MOST_PEOPLE),
        under_way=entries.count("under_way", MOST_PEOPLE),
        open_until=_moment(content.get("open_until", "")),
        minutes=entries.count("minutes", LONGEST_MINUTES),
    )


def _check_together(options: OutsideOptions) -> None:
    names = (options.id, *options.keep) if options.id else options.keep
    if taken := [*(name for name in names if name in TAKEN_NAMES), *(name for name in options.keep if name == "id")]:
        raise ValueError(f"outside: {taken[0]!r} has a meaning here already, expected another parameter's name")
    if len(set(names)) < len(names):
        raise ValueError(f"outside: a parameter is named twice in {', '.join(names)}")
    if options.keep and not options.id:
        raise ValueError("outside: keep needs id, the parameter that says who comes")
    if options.code and options.random_codes:
        raise ValueError(f"outside: code is {options.code!r} and random_codes true, expected one of them")
    for ending in ENDINGS:
        _check_placeholders(options, ending)


def _check_placeholders(options: OutsideOptions, ending: Ending) -> None:
    """Check that an address takes only what is there at that end: a code only who has completed the study."""
    has_code = ending == "complete" and bool(options.code or options.random_codes)
    known = [*(["id", *options.keep] if options.id else []), *(["code"] if has_code else [])]
    for name in PLACEHOLDER.findall(options.url(ending)):
        if name not in known:
            expected = ", ".join(f"{{{each}}}" for each in known) or "no placeholder with these options"
            raise ValueError(f"outside: {ending}_url holds {{{name}}}, expected {expected}")


def _kept(entries: Entries) -> tuple[str, ...]:
    value = entries.content.get("keep", ())
    is_short = is_list(value) and len(value) <= MOST_KEPT
    if not is_short or not all(isinstance(name, str) and PARAMETER.fullmatch(name) for name in value):
        raise entries.refusal("keep", f"a list of at most {MOST_KEPT} names of parameters")
    return tuple(value)


def _address(entries: Entries, key: str) -> str:
    address = entries.match(key, ADDRESS, "an address that begins with https:// and has no spaces")
    if len(address) > LONGEST_ADDRESS:
        raise ValueError(f"outside: {key} has {len(address)} characters, expected at most {LONGEST_ADDRESS}")
    return address


def _moment(value: Any) -> str:
    if isinstance(value, datetime):  # TOML has moments of its own
        value = value.isoformat()
    expected = "a date and time with its zone such as 2027-03-31T18:00+02:00, or nothing"
    try:
        has_zone = value == "" or datetime.fromisoformat(value).tzinfo is not None
    except (TypeError, ValueError) as error:
        raise ValueError(f"limits: open_until is {value!r}, expected {expected}") from error
    if not has_zone:
        raise ValueError(f"limits: open_until is {value!r}, expected {expected}")
    return str(value)
