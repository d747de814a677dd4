"""Define a study's options: its optional stages and their content, and how pairs are shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self, get_args

from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints, model_validator
from pydantic_core import PydanticCustomError

from app.study.design.design import Repetition
from app.study.design.groups import MOST_GROUPS, Groups
from app.study.languages.language_pack import MODEL
from app.study.option_fields import ANY_TIME, WITH_FILMS, ListOf, Names, Options, Setting, SettingError
from app.study.options.lab_sheet import LabSheet
from app.study.options.own_texts import (
    CONSENT,
    DEBRIEFING,
    LONGEST_TEXT,
    Languages,
    OwnTexts,
    check_own_texts,
    flat_own_texts,
    plain_document,
)
from app.study.options.practice import MOST_PRACTICE, PracticeFilms
from app.study.options.privacy_options import PrivacyOptions
from app.study.options.recruiting import LimitOptions, OutsideOptions
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
)
from app.study.questions.comprehension import ANSWERS, ANSWERS_ALONE
from app.study.questions.questionnaire import (
    DEFAULT_QUESTIONS,
    DEFAULT_SPOKEN_QUESTIONS,
    LONGEST_QUESTION,
    MOST_QUESTIONS,
    MOST_SPOKEN_QUESTIONS,
    Questions,
    SpokenQuestions,
)
from app.study.screening.screening import ScreeningOptions
from app.study.stages import INTERVIEW, OptionalStage, way_through
from app.study.trial.technique import TWO_VIDEOS
from app.study.trial.trial import Disturbance

VOID_ON: tuple[Disturbance, ...] = ("full screen", "hidden")
Pixels = Literal["fit", "1:1"]
FullScreen = Literal["asked", "required"]
SecondCodec = Literal["", "vp9", "av1"]  # besides H.264
Fallback = Literal["", "webcodecs"]
PairFilms = Literal["made", "decoded"]
RandomEffects = Literal["", "participants", "participants,datasets"]
RANDOM_EFFECTS: tuple[RandomEffects, ...] = get_args(RandomEffects)
LongText = Annotated[str, StringConstraints(strip_whitespace=True, max_length=LONGEST_TEXT)]


def _without_two_videos(given: object) -> object:
    """Read an older choice: nothing keeps two players at the same frame, or tells how far apart they are."""
    return "webcodecs" if given == TWO_VIDEOS else given


def _in_order(disturbances: tuple[Disturbance, ...]) -> tuple[Disturbance, ...]:
    return tuple(name for name in get_args(Disturbance) if name in disturbances)


def _both_or_none(lengths: tuple[int, ...]) -> tuple[int, ...]:
    if len(lengths) not in (0, 2):
        raise PydanticCustomError("window", "expected both")
    return lengths


class StudyOptions(Options):
    """A study's options; the defaults give the shortest study."""

    called: ClassVar[str] = "option "

    languages: Annotated[
        Languages,
        Setting(
            "Languages",
            "those that participants may choose from, the first being that of the plain texts here; one: it "
            "is fixed; empty: all reviewed ones, the plain texts being English",
            expected='a list of different tags such as ["en", "de"]',
        ),
    ] = ()
    texts: Annotated[
        OwnTexts,
        BeforeValidator(flat_own_texts),
        Setting("Own texts", "by language and key, in place of a language pack’s or besides the plain ones"),
    ] = Field(default_factory=dict)
    optional_stages: Annotated[
        ListOf[OptionalStage],
        Setting(
            "Stages besides the trials",
            "in this order",
            section="stages",
            choices={"screening": "screening", "practice": "practice", "interview": "interview (written questions)"},
            is_basic=True,
            expected="a list of screening, practice, interview",
        ),
    ] = ()
    screening: ScreeningOptions = ScreeningOptions()
    consent: Annotated[
        LongText,
        Setting(
            "Consent",
            "Markdown that participants agree to; an empty line separates paragraphs; empty: no consent is asked for",
            section="stages",
            kind="document",
            is_basic=True,
        ),
    ] = ""
    consent_version: Annotated[
        LongText, Setting("Version of the consent", "your name for this text", section="stages")
    ] = ""
    comprehension: Annotated[
        bool, Setting("Comprehension question", "the instructions end with a question on them", section="stages")
    ] = False
    questions: Annotated[
        Questions,
        Setting(
            "Written questions",
            "the interview; none while it is on: age, sex, experience, glasses, reasons",
            section="questions",
            kind="questions",
            expected=f"a list of at most {MOST_QUESTIONS} tables",
        ),
    ] = ()
    spoken_questions: Annotated[
        SpokenQuestions,
        Setting(
            "Spoken questions",
            "asked by the experimenter; one a line",
            section="questions",
            kind="spoken",
            expected=f"a list of at most {MOST_SPOKEN_QUESTIONS} different texts of 1 to {LONGEST_QUESTION} characters",
        ),
    ] = DEFAULT_SPOKEN_QUESTIONS
    debriefing: Annotated[
        LongText,
        Setting("Debriefing", "Markdown, shown at the end", section="stages", change=ANY_TIME, kind="document"),
    ] = ""
    protocol: Annotated[
        Protocol,
        Setting(
            "Protocol",
            "how participants judge",
            section="protocol",
            change=WITH_FILMS,
            is_basic=True,
            choices={
                "PC": "pair comparison: which of two is better, or neither",
                "CCR": "comparison category rating: how much better or worse B is than A, in seven grades",
                "ACR": "absolute category rating: how good each film is, one by one",
                "ACR-HR": "ACR with the reference hidden among the films",
                "DCR": "degradation category rating (DSIS): how disturbing a film’s flaws are beside the reference",
            },
        ),
    ] = PC
    scale: Annotated[
        Scale,
        Setting(
            "Scale",
            "of ACR, ACR-HR and DCR",
            section="protocol",
            choices={"5": "5 grades", "9": "9 grades", "11": "11 grades", "slider": "slider from 0 to 100"},
            expected="one of 5, 9, 11, 'slider'",
        ),
    ] = SCALES[0]
    both_orders: Annotated[
        bool, Setting("Both orders", "show every pair twice, the second time with A and B exchanged", section="trials")
    ] = False
    repeated_pairs: Annotated[
        int,
        Setting(
            "Repeated pairs",
            "how many pairs (or films) of each dataset are shown again, to see whether answers agree",
            section="trials",
        ),
    ] = Field(default=0, ge=0, le=100)
    identical_pairs: Annotated[
        int,
        Setting(
            "Identical pairs",
            "how many pairs of each dataset hold the same stimulus twice, to check attention",
            section="trials",
            change=WITH_FILMS,
        ),
    ] = Field(default=0, ge=0, le=100)
    adaptive_pairs: Annotated[
        int,
        Setting(
            "Adaptive pairs",
            "how many pairs of each dataset are chosen from the votes so far; 0: every pair is shown",
            section="trials",
        ),
    ] = Field(default=0, ge=0, le=10_000)
    free_exposure: Annotated[
        bool, Setting("Free exposure", "participants end it; the films repeat until then", section="trials")
    ] = False
    see_both: Annotated[
        bool, Setting("Both must be seen", "the vote waits until both of a pair were on screen", section="viewing")
    ] = True
    minimum_viewing_s: Annotated[
        float,
        Setting(
            "Minimum viewing, s",
            "seconds for which A and B must each have been on screen; at most half the exposure, unless it is free",
            section="viewing",
        ),
    ] = Field(default=0.0, ge=0, le=600)
    void_on: Annotated[
        ListOf[Disturbance],
        AfterValidator(_in_order),
        Setting(
            "A look is void when",
            "the pair then comes again at the end",
            section="viewing",
            choices={
                "full screen": "the full screen is left",
                "hidden": "the page is hidden",
                "blur": "another window is in front",
                "resize": "the window is resized",
            },
        ),
    ] = VOID_ON
    full_screen: Annotated[
        FullScreen,
        Setting(
            "Full screen",
            "leaving a full screen that is required voids the look",
            section="viewing",
            choices={"asked": "asked for", "required": "required: no film is shown without it"},
        ),
    ] = "asked"
    minimum_window: Annotated[
        ListOf[Annotated[int, Field(ge=1, le=10_000)]],
        AfterValidator(_both_or_none),
        Setting(
            "Minimum window, CSS pixels",
            "width and height of the smallest window in which films are shown; empty: any",
            section="viewing",
            kind="window",
            expected="width and height in CSS pixels, or neither for any window",
        ),
    ] = ()
    phones: Annotated[bool, Setting("Phones and tablets", "are let in", section="viewing", is_basic=True)] = True
    pixels: Annotated[
        Pixels,
        Setting(
            "Size of the films",
            "on the display",
            section="viewing",
            choices={"fit": "as large as the window allows", "1:1": "a pixel of a film is a pixel of the display"},
        ),
    ] = "fit"
    practice_dataset: Annotated[
        LongText,
        Setting(
            "Dataset for practice alone",
            "a scene that no trial shows; none: the set’s films for practice, else two films of the trials",
            section="practice",
            change=WITH_FILMS,
            kind="dataset",
            is_basic=True,
        ),
    ] = ""
    practice_pairs: Annotated[
        ListOf[PracticeFilms],
        Field(max_length=MOST_PRACTICE),
        Setting(
            "Films to practise with",
            "none: those that the line above says",
            section="practice",
            change=WITH_FILMS,
            kind="films",
            expected=f"at most {MOST_PRACTICE} pairs, each a dataset and two of its conditions",
        ),
    ] = ()
    reference: Annotated[
        LongText,
        Setting(
            "Reference",
            "condition to show as reference: beside every pair, in ACR-HR hidden among the films, in DCR "
            "before each film",
            section="protocol",
            change=WITH_FILMS,
            kind="condition",
            is_basic=True,
        ),
    ] = ""
    without: Annotated[
        Names,
        Setting(
            "Conditions to leave out",
            "never shown nor compared, such as truth, which is there for measures alone",
            section="protocol",
            change=WITH_FILMS,
            kind="conditions",
            is_basic=True,
        ),
    ] = ()
    lighter_films: Annotated[
        bool,
        Setting(
            "Lighter films",
            "also make films with fewer bytes, shown on slow lines; flags votes",
            section="films",
            change=WITH_FILMS,
        ),
    ] = False
    second_codec: Annotated[
        SecondCodec,
        Setting(
            "Second codec",
            "also make every film in it, for browsers without H.264",
            section="films",
            change=WITH_FILMS,
            choices={"": "none", "vp9": "VP9", "av1": "AV1"},
        ),
    ] = ""
    pair_films: Annotated[
        PairFilms,
        Setting(
            "Films of pairs",
            "how A and B are kept in step",
            section="films",
            change=WITH_FILMS,
            choices={
                "made": "a film of each pair, which every browser plays",
                "decoded": "none: browsers decode both films picture by picture (WebCodecs); few films to make, and "
                "who has no such browser is turned away",
            },
        ),
    ] = "made"
    fallback: Annotated[
        Fallback,
        BeforeValidator(_without_two_videos),
        Setting(
            "Fallback",
            "how to show a pair where its film does not play",
            section="films",
            change=WITH_FILMS,
            choices={
                "webcodecs": "decode both films picture by picture (WebCodecs)",
                "": "none: such browsers are turned away",
            },
        ),
    ] = "webcodecs"
    break_every: Annotated[
        int, Setting("Break after so many trials", "0: no breaks", section="breaks", is_basic=True)
    ] = Field(default=25, ge=0, le=10_000)
    break_s: Annotated[int, Setting("Shortest break, s", "0: as long as the participant likes", section="breaks")] = (
        Field(default=0, ge=0, le=3600)
    )
    random_effects: Annotated[
        RandomEffects,
        Setting(
            "Random effects",
            "fit the scores with them, too",
            section="analysis",
            change=ANY_TIME,
            choices={
                "": "none",
                "participants": "participants: how people at large would vote",
                "participants,datasets": "participants and datasets: on datasets like these, too",
            },
        ),
    ] = ""
    lapses: Annotated[
        bool,
        Setting(
            "Lapse rates",
            "fit the scores with careless answers weighted down, too",
            section="analysis",
            change=ANY_TIME,
        ),
    ] = False
    planned_participants: Annotated[
        int,
        Setting(
            "Planned participants",
            "results of fewer are called interim; 0: as many as may finish, until it is closed",
            section="analysis",
            change=ANY_TIME,
        ),
    ] = Field(default=0, ge=0, le=100_000)
    outside: OutsideOptions = OutsideOptions()
    limits: LimitOptions = LimitOptions()
    abandoned_after_h: Annotated[
        float,
        Setting(
            "Hours until a slot is given up",
            "without an answer for so long, an unfinished slot goes to another participant",
            section="limits",
            change=ANY_TIME,
            low=0.01,
            expected="hours, more than 0 and at most 1000000",
        ),
    ] = Field(default=24.0, gt=0, le=1_000_000)
    pause_on_failures: Annotated[
        int,
        Setting(
            "Pause after failing films",
            "for so many people since the study was opened; 0: never",
            section="limits",
            change=ANY_TIME,
        ),
    ] = Field(default=3, ge=0, le=10_000)
    groups: Annotated[
        Groups,
        Setting(
            "Groups",
            "that participants are assigned to at random, equally many to each; empty: none",
            expected=f"a list of at most {MOST_GROUPS} tables",
        ),
    ] = ()
    privacy: PrivacyOptions = PrivacyOptions()
    lab_sheet: LabSheet = LabSheet()

    @model_validator(mode="after")
    def _fits_protocol(self) -> Self:
        only_of_pairs = {"both_orders": self.both_orders, "adaptive_pairs": self.adaptive_pairs}
        check_with_protocol(self.protocol, self.scale, self.reference, only_of_pairs)
        of_pair_films = {"second_codec": self.second_codec, "lighter_films": self.lighter_films}
        if not self.has_pair_films and (wanted := [name for name, value in of_pair_films.items() if value]):
            value = of_pair_films[wanted[0]]
            raise SettingError(wanted[0], f"is {value!r}, and pair_films is 'decoded': leave one out")
        return self

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
    def has_pair_films(self) -> bool:
        """Are both films of a pair in one file, or is there but one?"""
        return self.is_shown_alone or self.pair_films == "made"

    @property
    def has_single_films(self) -> bool:
        """Is there a film of each stimulus, to be decoded together with another's?"""
        return bool(self.fallback) or not self.has_pair_films

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
        return self.but(optional_stages=tuple(dict.fromkeys([*self.optional_stages, stage])))

    @property
    def n_practice(self) -> int:
        """Rounds of practice: pairs that differ plainly and one of the same film twice; or the pairs' films, alone."""
        n_pairs = max(1, len(self.practice_pairs))
        return 2 * n_pairs if self.is_shown_alone else n_pairs + 1

    def as_json(self) -> dict[str, Any]:
        """Return the options as JSON, which `parse_options` reads."""
        content = super().as_json()
        screening = {key: value for key, value in content["screening"].items() if value is not None}
        return {**content, "screening": screening, "lab_sheet": self.lab_sheet.as_json()}


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
    options = StudyOptions.read(dict(content))
    questions = options.questions or (DEFAULT_QUESTIONS if INTERVIEW in options.optional_stages else ())
    check_own_texts(options.texts, questions)
    texts = {language: dict(said) for language, said in options.texts.items()}
    first = options.languages[0] if options.languages else MODEL
    return options.but(
        questions=questions,
        consent=plain_document(options.consent, texts, first, CONSENT),
        debriefing=plain_document(options.debriefing, texts, first, DEBRIEFING),
        texts={language: said for language, said in texts.items() if said},
    )


def without_effect(options: StudyOptions) -> dict[str, SettingError]:
    """Return options that the study's protocol makes no use of, each with the refusal that says why."""
    of_pairs = {"identical_pairs": options.identical_pairs, "minimum_viewing_s": options.minimum_viewing_s}
    if not options.is_shown_alone:
        return {}
    return {
        name: SettingError(name, f"is {value:g}, but protocol {options.protocol} shows films one by one: expected 0")
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
        raise SettingError(
            "minimum_viewing_s",
            f"is {options.minimum_viewing_s:g}, and a pair is shown for {exposure_s:g} s: "
            f"expected at most half of it, {exposure_s / 2:g}",
        )
