"""Define how people come to a study from a recruiting platform, how they go back to it, and how many are taken in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated, Any, Literal, Self, get_args
from urllib.parse import quote

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from app.study.option_fields import ANY_TIME, ListOf, Options, Setting, SettingError

Resume = Literal["anywhere", "same browser"]
Ending = Literal["complete", "screened_out", "no_consent", "full", "timed_out", "withdrawn", "failed"]

ENDINGS: tuple[Ending, ...] = get_args(Ending)
PARAMETER = "[A-Za-z][A-Za-z0-9_.-]{0,39}"  # the name of a URL's parameter
TAKEN_NAMES = ("another", "language", "code")  # parameters of our pages, and placeholders
VALUE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._~@:+=-]{0,99}")  # no placeholder left unfilled, and no formula in a table
PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
LEFT_TO_FILL = re.compile(r"YOUR-[A-Z-]+[A-Z]")  # of an address that a platform's preset begins
MOST_KEPT = 10
Address = Annotated[
    str, StringConstraints(pattern=r"^(https://[A-Za-z0-9.-]+(:\d{1,5})?(/[!-~]*|\?[!-~]*)?)?$", max_length=1000)
]
AN_ADDRESS = "an address that begins with https:// and has no spaces, of at most 1000 characters, or nothing"


def _address(label: str, text: str = "empty: none") -> Setting:
    return Setting(label, text, ANY_TIME, expected=AN_ADDRESS)


@dataclass(frozen=True)
class Arrival:
    """What a platform's link says of the person who follows it: the outside id, and the parameters to keep."""

    outside_id: str
    kept: Mapping[str, str] = field(default_factory=dict)


class OutsideOptions(Options):
    """How participants come from a recruiting platform, and how they go back.

    In an address, `{id}`, `{code}` and kept names stand for their values.
    """

    id: Annotated[
        str,
        Setting(
            "Parameter of the link that says who comes",
            "for example PROLIFIC_PID; empty: people come without an id",
            ANY_TIME,
            expected="the name of a parameter such as PROLIFIC_PID, or nothing",
        ),
    ] = Field(default="", pattern=rf"^({PARAMETER})?$")
    keep: Annotated[
        ListOf[Annotated[str, StringConstraints(pattern=rf"^{PARAMETER}$")]],
        Setting(
            "Further parameters to keep",
            "apart by spaces",
            ANY_TIME,
            expected=f"a list of at most {MOST_KEPT} names of parameters",
        ),
    ] = Field(default=(), max_length=MOST_KEPT)
    resume: Annotated[
        Resume,
        Setting(
            "Who comes with a known id",
            "after having left",
            ANY_TIME,
            choices={
                "anywhere": "goes on, in any browser",
                "same browser": "goes on only in the same browser, or by the resume code",
            },
        ),
    ] = "anywhere"
    code: Annotated[
        str,
        Setting(
            "Completion code",
            "of everybody, at the end; empty: none",
            ANY_TIME,
            expected="1 to 40 letters, digits, - or _, or nothing",
        ),
    ] = Field(default="", pattern=r"^[A-Za-z0-9_-]{0,40}$")
    random_codes: Annotated[
        bool, Setting("Random codes", "a completion code for each participant instead", ANY_TIME)
    ] = False
    complete_url: Annotated[
        Address,
        _address(
            "Address at the end",
            "begins with https://; {id}, {code} and kept names stand for their values; empty: none",
        ),
    ] = ""
    screened_out_url: Annotated[Address, _address("Address after screening out")] = ""
    no_consent_url: Annotated[Address, _address("Address without consent")] = ""
    full_url: Annotated[
        Address,
        _address("Address when nobody more is taken in", "empty: that without consent, which gives the place back"),
    ] = ""
    timed_out_url: Annotated[Address, _address("Address when the time has run out")] = ""
    withdrawn_url: Annotated[Address, _address("Address after withdrawing")] = ""
    failed_url: Annotated[
        Address,
        _address("Address when a film cannot be shown", "empty: that without consent, which gives the place back"),
    ] = ""
    redirect_after_s: Annotated[
        int, Setting("Seconds until the browser goes there", "0: only by the button", ANY_TIME)
    ] = Field(default=10, ge=0, le=600)  # long enough to read that the code is on the page and where the browser goes

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        _check_together(self)
        return self

    @property
    def is_on(self) -> bool:
        """Is anything kept of a participant's way from and to a platform?"""
        return bool(self.id) or self.random_codes

    @property
    def without_codes(self) -> OutsideOptions:
        """The same without what a platform pays for: the completion code, and the addresses that lead back."""
        return self.but(code="", **{f"{ending}_url": "" for ending in ENDINGS})

    def url(self, ending: Ending) -> str:
        """Return the address of an ending, with its placeholders; empty: none."""
        if ending in ("failed", "full"):
            return str(getattr(self, f"{ending}_url")) or self.no_consent_url or self.failed_url
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
        return PLACEHOLDER.sub(lambda place: quote(values.get(place[1], ""), safe=""), self.url(ending))

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


def _moment(value: Any) -> Any:
    """Check a date and time with its zone, or nothing; TOML has moments of its own."""
    text = value.isoformat() if isinstance(value, datetime) else value
    try:
        has_zone = text == "" or datetime.fromisoformat(text).tzinfo is not None
    except (TypeError, ValueError):
        has_zone = False
    if not has_zone:
        raise SettingError(
            "limits.open_until",
            f"is {value!r:.120}, expected a date and time with its zone such as 2027-03-31T18:00+02:00, or nothing",
        )
    return text


class LimitOptions(Options):
    """How many are taken in, until when, and how long each may take."""

    finished: Annotated[
        int, Setting("Most who finish", "those under way count; 0: any number", ANY_TIME, is_basic=True)
    ] = Field(default=0, ge=0, le=1_000_000)
    under_way: Annotated[int, Setting("Most at the same time", "0: any number", ANY_TIME)] = Field(
        default=0, ge=0, le=1_000_000
    )
    open_until: Annotated[
        str,
        BeforeValidator(_moment),
        Setting("Open until", "date, time and zone, such as 2027-03-31T18:00+02:00; empty: no end", ANY_TIME),
    ] = ""
    minutes: Annotated[int, Setting("Minutes each may take", "to the last vote; 0: any time", ANY_TIME)] = Field(
        default=0,
        ge=0,
        le=10_080,  # a week
    )

    def is_over(self, now: datetime) -> bool:
        """Is the last moment to begin past?"""
        return bool(self.open_until) and now >= datetime.fromisoformat(self.open_until)

    def is_full(self, n_finished: int, n_under_way: int) -> bool:
        """Is nobody more to be taken in while so many have finished and so many are under way?"""
        is_finished = bool(self.finished) and n_finished + n_under_way >= self.finished
        return is_finished or (bool(self.under_way) and n_under_way >= self.under_way)


def _check_together(options: OutsideOptions) -> None:
    names = (options.id, *options.keep) if options.id else options.keep
    if taken := [*(name for name in names if name in TAKEN_NAMES), *(name for name in options.keep if name == "id")]:
        words = f"{taken[0]!r} has a meaning here already, expected another parameter's name"
        raise SettingError("outside.id" if taken[0] == options.id else "outside.keep", words, "outside:")
    if len(set(names)) < len(names):
        raise SettingError("outside.keep", f"a parameter is named twice in {', '.join(names)}", "outside:")
    if options.keep and not options.id:
        raise SettingError("outside.keep", "needs id, the parameter that says who comes")
    if options.code and options.random_codes:
        raise SettingError("outside.code", f"is {options.code!r} and random_codes true, expected one of them")
    for ending in ENDINGS:
        if left := LEFT_TO_FILL.search(options.url(ending)):
            raise SettingError(
                f"outside.{ending}_url",
                f"holds {left[0]}, which stands for what the platform shows you: put that in its "
                "place, or empty the address",
            )
        _check_placeholders(options, ending)


def _check_placeholders(options: OutsideOptions, ending: Ending) -> None:
    """Check that an address takes only what is there at that end: a code only who has completed the study."""
    has_code = ending == "complete" and bool(options.code or options.random_codes)
    known = [*(["id", *options.keep] if options.id else []), *(["code"] if has_code else [])]
    for name in PLACEHOLDER.findall(options.url(ending)):
        if name not in known:
            expected = ", ".join(f"{{{each}}}" for each in known) or "no placeholder with these options"
            raise SettingError(f"outside.{ending}_url", f"holds {{{name}}}, expected {expected}")
