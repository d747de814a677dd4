"""Define a study's options: its optional stages and their content, and how pairs are shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal, get_args

from app.study.design.design import Repetition
from app.study.design.groups import Group, parse_groups
from app.study.languages.language_pack import MODEL
from app.study.options.entries import Entries, is_list
from app.study.options.lab_sheet import LabSheet, parse_lab_sheet
from app.study.options.practice import PracticeFilms, parse_practice_pairs
from app.study.options.privacy import PrivacyOptions, parse_privacy
from app.study.options.recruiting import LimitOptions, OutsideOptions, parse_limits, parse_outside
from app.study.options.wording import (
    CONSENT,
    DEBRIEFING,
    LONGEST_TEXT,
    OwnTexts,
    parse_languages,
    parse_own_texts,
    plain_document,
)
from app.study.protocols import (
    PC,
    SCALES,
    SHOWN_ALONE,
    WITH_REFERENCE,
    Grades,
    Protocol,
    Scale,
    check_with_protocol,
    grades_of,
    parse_protocol,
)
from app.study.questions.comprehension import ANSWERS, ANSWERS_ALONE
from app.study.questions.questionnaire import (
    DEFAULT_QUESTIONS,
    DEFAULT_SPOKEN_QUESTIONS,
    Question,
    parse_questions,
    parse_spoken_questions,
)
from app.study.screening.screening import ScreeningOptions, parse_screening
from app.study.stages import INTERVIEW, OPTIONAL_STAGES, way_through
from app.study.trial.technique import TWO_VIDEOS, WEBCODECS
from app.study.trial.trial import Disturbance

MOST_CHECKS = 100  # of a kind in each dataset
MOST_ADAPTIVE = 10_000  # pairs of each dataset
BREAK_EVERY = 25  # trials
LONGEST_BREAK_S = 3600
VOID_ON: tuple[Disturbance, ...] = ("full screen", "hidden")
RANDOM_EFFECTS = ("", "participants", "participants,datasets")
SECOND_CODECS = ("", "vp9", "av1")  # besides H.264
FALLBACKS = ("", WEBCODECS, TWO_VIDEOS)
Pixels = Literal["fit", "1:1"]
FullScreen = Literal["asked", "required"]
LONGEST_MINIMUM_S = 600.0  # of looking at each of both
LARGEST_WINDOW = 10_000  # CSS pixels
MOST_HOURS = 1_000_000  # a century, which dates can still be reckoned with
ABANDONED_AFTER_H = 24.0  # without an answer; a participant who returns the next day keeps the slot


@dataclass(frozen=True)
class StudyOptions:
    """A study's options; the defaults give the shortest study.

    Parameters
    ----------
    languages : those that participants may choose from, the first being that of the plain texts here; one: it is
        fixed; empty: all reviewed ones, the plain texts being English
    texts : the study's own texts by language and key, in place of a language pack's or besides the plain ones
    optional_stages : those of screening, practice and interview that are on
    screening : its tests and limits
    consent : Markdown that a participant agrees to, paragraphs apart by an empty line; empty: no consent is asked for
    consent_version : its authors' name for this text
    comprehension : do the instructions end with a comprehension question?
    questions : of the interview
    spoken_questions : asked aloud by the experimenter, who notes the answers in a form of the dashboard
    debriefing : Markdown that participants read at the end, paragraphs apart by an empty line
    protocol : how participants judge: PC compares pairs, ACR and ACR-HR rate films one by one, DCR against a reference,
        CCR says how much better one of a pair is
    scale : of ACR, ACR-HR and DCR: number of grades, or a slider
    both_orders : show every pair twice, the second time with A and B exchanged
    repeated_pairs : number of pairs of each dataset that are shown again, unchanged
    identical_pairs : number of pairs of each dataset that hold the same stimulus twice
    adaptive_pairs : number of pairs of each dataset to choose from the votes so far; 0: every pair is shown
    free_exposure : the films play until the participant ends the exposure
    see_both : the vote waits until both of a pair were on screen; the page shows the pair again
    minimum_viewing_s : seconds for which A and B must each have been on screen before the vote; the page shows the pair
        again until they were
    void_on : what voids a look while it lasts, so that the pair comes again at the end: the page is hidden, the full
        screen left, another window in front (blur), the window resized; what is not named here is recorded only
    full_screen : asked for only (asked), or no film is shown without it (required)
    minimum_window : width and height, CSS pixels, of the smallest window in which films are shown; empty: any
    phones : are phones and tablets let in?
    pixels : the films are as large as the window allows (fit), or a pixel of a film is a pixel of the display (1:1)
    practice_dataset : the dataset that is for practice only: no trial shows it; empty: none
    practice_pairs : films to practise with; empty: those that the stimulus set names for practice, else two that differ
        plainly
    reference : the condition shown as the reference beside every pair, and compared with nothing; in ACR-HR hidden
        among the films, in DCR what each film is rated against; empty: none
    without : conditions of the stimulus set that are left out: neither shown nor compared
    second_codec : codec of further films, for browsers without H.264; empty: none
    fallback : how to show a pair in a browser that cannot play one film of both: decode a film of each picture by
        picture (webcodecs); failing that, use two players, which may be a frame apart (two videos); empty: not at all
    lighter_films : are films with fewer bytes made and, on a slow line, shown? They look a little worse, A and B alike,
        and votes on them are marked
    break_every : trials after which a break is offered; 0: never
    break_s : how long a break lasts at least, s; 0: as long as its participant likes
    random_effects : what the scores are also fitted with as random effects: `participants`, or `participants,datasets`
    abandoned_after_h : hours without an answer after which another participant gets an unfinished slot
    outside : how people come from a recruiting platform and go back
    limits : how many are taken in, until when, and how long each may take
    groups : that participants are assigned to at random, equally many to each; empty: none
    lab_sheet : the room and the display, for the record
    privacy : who answers for participants' data, and how long they are kept
    """

    languages: tuple[str, ...] = ()
    texts: OwnTexts = field(default_factory=dict)
    optional_stages: tuple[str, ...] = ()
    screening: ScreeningOptions = field(default_factory=ScreeningOptions)
    consent: str = ""
    consent_version: str = ""
    comprehension: bool = False
    questions: tuple[Question, ...] = ()
    spoken_questions: tuple[str, ...] = DEFAULT_SPOKEN_QUESTIONS
    debriefing: str = ""
    protocol: Protocol = PC
    scale: Scale = SCALES[0]
    both_orders: bool = False
    repeated_pairs: int = 0
    identical_pairs: int = 0
    adaptive_pairs: int = 0
    free_exposure: bool = False
    see_both: bool = True
    minimum_viewing_s: float = 0.0
    void_on: tuple[Disturbance, ...] = VOID_ON
    full_screen: FullScreen = "asked"
    minimum_window: tuple[int, ...] = ()
    phones: bool = True
    pixels: Pixels = "fit"
    practice_dataset: str = ""
    practice_pairs: tuple[PracticeFilms, ...] = ()
    reference: str = ""
    without: tuple[str, ...] = ()
    second_codec: str = ""
    fallback: str = WEBCODECS
    lighter_films: bool = False
    break_every: int = BREAK_EVERY
    break_s: int = 0
    random_effects: str = ""
    abandoned_after_h: float = ABANDONED_AFTER_H
    outside: OutsideOptions = field(default_factory=OutsideOptions)
    limits: LimitOptions = field(default_factory=LimitOptions)
    groups: tuple[Group, ...] = ()
    lab_sheet: LabSheet = field(default_factory=LabSheet)
    privacy: PrivacyOptions = field(default_factory=PrivacyOptions)

    @property
    def repetition(self) -> Repetition:
        """Trials shown besides every pair, or every film, once."""
        identical = 0 if self.is_shown_alone else self.identical_pairs
        return Repetition(self.both_orders, self.repeated_pairs, identical)

    @property
    def comprehension_answers(self) -> tuple[str, ...]:
        """Answers to the comprehension question, of which one is right."""
        return ANSWERS_ALONE if self.is_shown_alone else ANSWERS

    @property
    def grades(self) -> Grades | None:
        """The scale that participants rate on; None where they choose the better of two."""
        return grades_of(self.protocol, self.scale)

    @property
    def is_shown_alone(self) -> bool:
        """Does a trial show one film?"""
        return self.protocol in SHOWN_ALONE

    @property
    def reference_beside(self) -> str:
        """The condition that participants can view besides A and B; empty: none."""
        return "" if self.protocol in WITH_REFERENCE else self.reference

    @property
    def disturbances(self) -> tuple[Disturbance, ...]:
        """What voids a look: `void_on`, and leaving a full screen that is required."""
        needed: tuple[Disturbance, ...] = ("full screen",) if self.full_screen == "required" else ()
        return tuple(dict.fromkeys((*needed, *self.void_on)))

    @property
    def way(self) -> tuple[str, ...]:
        """The study's stages in order."""
        return way_through(self.optional_stages)

    def with_stage(self, stage: str) -> StudyOptions:
        """Return the options with an optional stage on."""
        return replace(self, optional_stages=tuple(dict.fromkeys([*self.optional_stages, stage])))

    @property
    def n_practice(self) -> int:
        """Rounds of practice: pairs that differ plainly and one of the same film twice; or the pairs' films, alone."""
        n_pairs = max(1, len(self.practice_pairs))
        return 2 * n_pairs if self.is_shown_alone else n_pairs + 1

    def as_json(self) -> dict[str, Any]:
        """Return the options as JSON, which `parse_options` reads."""
        content = _with_lists(asdict(self))
        screening = {key: value for key, value in content["screening"].items() if value is not None}
        return {**content, "screening": screening, "lab_sheet": self.lab_sheet.as_json()}


def _with_lists(value: Any) -> Any:
    """Return tables and lists, as deep as they are, with lists in place of tuples, as JSON has them."""
    if isinstance(value, Mapping):
        return {key: _with_lists(part) for key, part in value.items()}
    return [_with_lists(part) for part in value] if isinstance(value, list | tuple) else value


def overridden(options: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with those given in their place; the keys of a table replace one by one."""
    tables = {
        key: {**value, **given[key]}
        for key, value in options.items()
        if isinstance(value, Mapping) and isinstance(given.get(key), Mapping)
    }
    return {**options, **given, **tables}


def parse_options(content: Mapping[str, Any]) -> StudyOptions:
    """Read options from a study file or the database.

    Raises
    ------
    ValueError
        Naming an unknown key, or a key with an invalid value.
    """
    known = {option.name for option in fields(StudyOptions)}
    if unknown := sorted(set(content) - known):
        raise ValueError(f"option {unknown[0]!r} is not known; expected some of {', '.join(sorted(known))}")
    entries = Entries(content)
    stages = content.get("optional_stages", ())
    if not is_list(stages):
        raise ValueError(f"optional_stages is {stages!r}, expected a list of {', '.join(OPTIONAL_STAGES)}")
    way_through(stages)
    questions = parse_questions(content.get("questions", ()))
    if INTERVIEW in stages and not questions:
        questions = DEFAULT_QUESTIONS
    protocol, scale = parse_protocol(content)
    languages = parse_languages(content.get("languages", ()))
    texts = parse_own_texts(content.get("texts", {}), questions)
    first = languages[0] if languages else MODEL
    consent = plain_document(entries.text("consent", LONGEST_TEXT), texts, first, CONSENT)
    debriefing = plain_document(entries.text("debriefing", LONGEST_TEXT), texts, first, DEBRIEFING)
    options = StudyOptions(
        languages=languages,
        texts={language: said for language, said in texts.items() if said},
        optional_stages=tuple(stages),
        screening=parse_screening(content.get("screening", {})),
        consent=consent,
        consent_version=entries.text("consent_version", LONGEST_TEXT),
        comprehension=entries.flag("comprehension"),
        questions=questions,
        spoken_questions=parse_spoken_questions(content.get("spoken_questions")),
        debriefing=debriefing,
        protocol=protocol,
        scale=scale,
        both_orders=entries.flag("both_orders"),
        repeated_pairs=entries.count("repeated_pairs", MOST_CHECKS),
        identical_pairs=entries.count("identical_pairs", MOST_CHECKS),
        adaptive_pairs=entries.count("adaptive_pairs", MOST_ADAPTIVE),
        free_exposure=entries.flag("free_exposure"),
        see_both=entries.flag("see_both", default=True),
        minimum_viewing_s=entries.number("minimum_viewing_s", (0, LONGEST_MINIMUM_S), 0.0),
        void_on=_disturbances(entries),
        full_screen=entries.one_of("full_screen", get_args(FullScreen), "asked"),
        minimum_window=_minimum_window(entries),
        phones=entries.flag("phones", default=True),
        pixels=entries.one_of("pixels", get_args(Pixels), "fit"),
        practice_dataset=entries.text("practice_dataset", LONGEST_TEXT),
        practice_pairs=parse_practice_pairs(content.get("practice_pairs", ())),
        reference=entries.text("reference", LONGEST_TEXT),
        without=entries.names("without"),
        second_codec=entries.one_of("second_codec", SECOND_CODECS),
        fallback=entries.one_of("fallback", FALLBACKS, WEBCODECS),
        lighter_films=entries.flag("lighter_films"),
        break_every=entries.count("break_every", 10_000, BREAK_EVERY),
        break_s=entries.count("break_s", LONGEST_BREAK_S),
        random_effects=entries.one_of("random_effects", RANDOM_EFFECTS),
        abandoned_after_h=_hours(entries, "abandoned_after_h"),
        outside=parse_outside(content.get("outside", {})),
        limits=parse_limits(content.get("limits", {})),
        groups=parse_groups(content.get("groups", ())),
        lab_sheet=parse_lab_sheet(content.get("lab_sheet", {})),
        privacy=parse_privacy(content.get("privacy", {})),
    )
    only_of_pairs = {name: getattr(options, name) for name in ("both_orders", "adaptive_pairs")}
    check_with_protocol(protocol, options.reference, only_of_pairs)
    return options


def without_effect(options: StudyOptions) -> dict[str, str]:
    """Return options that the study's protocol makes no use of, each with a sentence that says why."""
    of_pairs = {"identical_pairs": options.identical_pairs, "minimum_viewing_s": options.minimum_viewing_s}
    if not options.is_shown_alone:
        return {}
    return {
        name: f"{name} is {value:g}, but protocol {options.protocol} shows films one by one: expected 0"
        for name, value in of_pairs.items()
        if value
    }


def check_minimum_viewing(options: StudyOptions, exposure_s: float) -> None:
    """Check that one showing of a pair can be enough.

    Parameters
    ----------
    options : the study's
    exposure_s : how long a pair is shown

    Raises
    ------
    ValueError
        If A and B cannot both be on screen for the minimum viewing time.
    """
    if not options.free_exposure and 2 * options.minimum_viewing_s > exposure_s:
        raise ValueError(
            f"minimum_viewing_s is {options.minimum_viewing_s:g}, and a pair is shown for {exposure_s:g} s: "
            f"expected at most half of it, {exposure_s / 2:g}"
        )


def _disturbances(entries: Entries) -> tuple[Disturbance, ...]:
    value, known = entries.content.get("void_on", VOID_ON), get_args(Disturbance)
    if not is_list(value) or not set(map(str, value)) <= set(known):
        raise entries.refusal("void_on", f"a list of {', '.join(known)}")
    return tuple(name for name in known if name in value)


def _minimum_window(entries: Entries) -> tuple[int, ...]:
    value = entries.content.get("minimum_window", ())
    is_size = is_list(value) and len(value) in (0, 2)
    if not is_size or not all(type(length) is int and 0 < length <= LARGEST_WINDOW for length in value):
        raise entries.refusal("minimum_window", "[width, height] in CSS pixels, or [] for any window")
    return tuple(value)


def _hours(entries: Entries, key: str) -> float:
    value = entries.content.get(key, ABANDONED_AFTER_H)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= MOST_HOURS:
        raise entries.refusal(key, f"hours, more than 0 and at most {MOST_HOURS}")
    return float(value)
