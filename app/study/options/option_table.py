"""List every setting of a study in one table: its words and bounds for forms and commands, and when it may change.

Only the standard library is imported here, so that the command line reads the table without delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Change = Literal["any time", "until begun", "with films"]
ANY_TIME: Change = "any time"
UNTIL_BEGUN: Change = "until begun"  # all participants see the same study
WITH_FILMS: Change = "with films"  # until begun, and the films are made again from the stimulus set

Kind = Literal[
    "text",
    "document",
    "flag",
    "whole",
    "number",
    "choice",
    "several",
    "names",
    "window",
    "dataset",
    "condition",
    "conditions",
    "questions",
    "spoken",
    "films",
]


@dataclass(frozen=True)
class Setting:
    """A setting of a study, as a form shows it.

    Parameters
    ----------
    name : key in the study file, within [options]; of a table of options "table.key"
    section : of SECTIONS
    label, text : what the form calls it, and what it does in a sentence
    kind : how it is entered
    change : when it may change
    choices : of a choice, or of several: what they mean, by value
    low, high, step : of a number; step "any": any number
    may_be_empty : a number may be left out
    """

    name: str
    section: str
    label: str
    text: str
    kind: Kind
    change: Change = UNTIL_BEGUN
    choices: Mapping[str, str] = field(default_factory=dict)
    low: float | None = None
    high: float | None = None
    step: str = "1"
    may_be_empty: bool = False

    @property
    def option(self) -> str:
        """Name of the option that it belongs to: its own, or its table's."""
        return self.name.partition(".")[0]


SECTIONS: Mapping[str, str] = {
    "study": "Study",
    "protocol": "Protocol and conditions",
    "trials": "Trials",
    "viewing": "How films are viewed",
    "breaks": "Breaks",
    "films": "Films and browsers",
    "stages": "Stages and texts",
    "practice": "Practice",
    "screening": "Screening",
    "questions": "Questions",
    "outside": "People from a recruiting platform",
    "limits": "How many are taken in",
    "privacy": "Privacy",
    "lab_sheet": "Lab sheet",
    "analysis": "Analysis",
}
SECTION_NOTES: Mapping[str, str] = {
    "practice": "Used where the stage practice is on.",
    "screening": "Used where the stage screening is on; not a diagnosis.",
    "questions": "Written questions are asked where the stage interview is on; spoken ones by the experimenter.",
    "outside": "Prolific, SONA, MTurk, Cint, any other.",
    "privacy": "Participants read this on the study’s privacy page, with what the study collects and how to withdraw.",
    "lab_sheet": "The room and the display, for the record; empty where not known.",
    "analysis": "Of choices between two; results are computed anew.",
}

# The study's own columns; all others are options.
COLUMNS = ("name", "exposure_s", "seed")
# Options that have a page of their own: the study's Texts, and its Invitations.
ELSEWHERE: Mapping[str, Change] = {"languages": UNTIL_BEGUN, "texts": UNTIL_BEGUN, "groups": UNTIL_BEGUN}

SETTINGS: tuple[Setting, ...] = (
    Setting("name", "study", "Name", "shown to participants and experimenters", "text", ANY_TIME),
    Setting(
        "exposure_s", "study", "Seconds a pair or film is shown", "empty in a new study: as long as the shortest video",
        "number", low=0.1, high=3600, step="any", may_be_empty=True,
    ),
    Setting(
        "seed", "study", "Seed of all orders", "a whole number; empty in a new study: drawn at random",
        "whole", low=0, high=2**63 - 1, may_be_empty=True,
    ),
    Setting(
        "protocol", "protocol", "Protocol", "how participants judge", "choice", WITH_FILMS,
        {
            "PC": "pair comparison: which of two is better, or neither",
            "CCR": "comparison category rating: how much better or worse B is than A, in seven grades",
            "ACR": "absolute category rating: how good each film is, one by one",
            "ACR-HR": "ACR with the reference hidden among the films",
            "DCR": "degradation category rating (DSIS): how disturbing a film’s flaws are beside the reference",
        },
    ),
    Setting(
        "scale", "protocol", "Scale", "of ACR, ACR-HR and DCR", "choice",
        choices={"5": "5 grades", "9": "9 grades", "11": "11 grades", "slider": "slider from 0 to 100"},
    ),
    Setting(
        "reference", "protocol", "Reference",
        "condition to show as reference: beside every pair, in ACR-HR hidden among the films, in DCR before each film",
        "condition", WITH_FILMS,
    ),
    Setting(
        "without", "protocol", "Conditions to leave out",
        "never shown nor compared, such as truth, which is there for measures alone", "conditions", WITH_FILMS,
    ),
    Setting(
        "both_orders", "trials", "Both orders", "show every pair twice, the second time with A and B exchanged", "flag",
    ),
    Setting(
        "repeated_pairs", "trials", "Repeated pairs",
        "how many pairs (or films) of each dataset are shown again, to see whether answers agree", "whole",
        low=0, high=100,
    ),
    Setting(
        "identical_pairs", "trials", "Identical pairs",
        "how many pairs of each dataset hold the same stimulus twice, to check attention", "whole", WITH_FILMS,
        low=0, high=100,
    ),
    Setting(
        "adaptive_pairs", "trials", "Adaptive pairs",
        "how many pairs of each dataset are chosen from the votes so far; 0: every pair is shown", "whole",
        low=0, high=10_000,
    ),
    Setting("free_exposure", "trials", "Free exposure", "participants end it; the films repeat until then", "flag"),
    Setting(
        "see_both", "viewing", "Both must be seen", "the vote waits until both of a pair were on screen", "flag",
    ),
    Setting(
        "minimum_viewing_s", "viewing", "Minimum viewing, s",
        "seconds for which A and B must each have been on screen; at most half the exposure, unless it is free",
        "number", low=0, high=600, step="any",
    ),
    Setting(
        "void_on", "viewing", "A look is void when", "the pair then comes again at the end", "several",
        choices={
            "full screen": "the full screen is left",
            "hidden": "the page is hidden",
            "blur": "another window is in front",
            "resize": "the window is resized",
        },
    ),
    Setting(
        "full_screen", "viewing", "Full screen", "leaving a full screen that is required voids the look", "choice",
        choices={"asked": "asked for", "required": "required: no film is shown without it"},
    ),
    Setting(
        "minimum_window", "viewing", "Minimum window, CSS pixels",
        "width and height of the smallest window in which films are shown; empty: any", "window", low=1, high=10_000,
    ),
    Setting("phones", "viewing", "Phones and tablets", "are let in", "flag"),
    Setting(
        "pixels", "viewing", "Size of the films", "on the display", "choice",
        choices={"fit": "as large as the window allows", "1:1": "a pixel of a film is a pixel of the display"},
    ),
    Setting(
        "break_every", "breaks", "Break after so many trials", "0: no breaks", "whole", low=0, high=10_000,
    ),
    Setting(
        "break_s", "breaks", "Shortest break, s", "0: as long as the participant likes", "whole", low=0, high=3600,
    ),
    Setting(
        "lighter_films", "films", "Lighter films", "also make films with fewer bytes, shown on slow lines; flags votes",
        "flag", WITH_FILMS,
    ),
    Setting(
        "second_codec", "films", "Second codec", "also make every film in it, for browsers without H.264", "choice",
        WITH_FILMS, {"": "none", "vp9": "VP9", "av1": "AV1"},
    ),
    Setting(
        "fallback", "films", "Fallback", "how to show a pair where its film does not play", "choice", WITH_FILMS,
        {
            "webcodecs": "decode both films picture by picture (WebCodecs)",
            "two videos": "if need be two players, which may be a frame apart; such votes are flagged",
            "": "none: such browsers are turned away",
        },
    ),
    Setting(
        "optional_stages", "stages", "Stages besides the trials", "in this order", "several",
        choices={"screening": "screening", "practice": "practice", "interview": "interview (written questions)"},
    ),
    Setting(
        "consent", "stages", "Consent",
        "Markdown that participants agree to; an empty line separates paragraphs; empty: no consent is asked for",
        "document",
    ),
    Setting("consent_version", "stages", "Version of the consent", "your name for this text", "text"),
    Setting(
        "comprehension", "stages", "Comprehension question", "the instructions end with a question on them", "flag",
    ),
    Setting("debriefing", "stages", "Debriefing", "Markdown, shown at the end", "document", ANY_TIME),
    Setting(
        "practice_dataset", "practice", "Dataset for practice alone",
        "no trial shows it; none: the set’s films for practice, else two films of the trials", "dataset", WITH_FILMS,
    ),
    Setting(
        "practice_pairs", "practice", "Films to practise with", "none: those that the line above says", "films",
        WITH_FILMS,
    ),
    Setting(
        "screening.tests", "screening", "Tests", "that are taken", "several",
        choices={"acuity": "acuity", "colour": "colour vision"},
    ),
    Setting(
        "screening.acuity_limit", "screening", "Required acuity, logMAR", "0.18 is 20/30; larger is worse", "number",
        low=-0.3, high=1, step="0.01",
    ),
    Setting(
        "screening.distance", "screening", "Viewing distance", "how it is known", "choice",
        choices={
            "typed": "the participant types it",
            "fixed": "fixed by the laboratory",
            "blind spot": "measured with the blind spot",
        },
    ),
    Setting(
        "screening.distance_cm", "screening", "Fixed distance, cm", "only for a fixed distance", "number",
        low=20, high=600, step="0.5", may_be_empty=True,
    ),
    Setting(
        "screening.colour_axes", "screening", "Colour plates", "confusion lines that are tested", "several",
        choices={"protan": "protan", "deutan": "deutan", "tritan": "tritan"},
    ),
    Setting(
        "screening.colour_misses", "screening", "Plates that may be missed", "of each confusion line", "whole",
        low=0, high=4,
    ),
    Setting(
        "screening.on_failure", "screening", "A participant who does not pass", "or who skips a test", "choice",
        choices={"record": "takes part; the experimenter decides", "stop": "goes no further"},
    ),
    Setting(
        "questions", "questions", "Written questions",
        "the interview; none while it is on: age, sex, experience, glasses, reasons", "questions",
    ),
    Setting("spoken_questions", "questions", "Spoken questions", "asked by the experimenter; one a line", "spoken"),
    Setting(
        "outside.id", "outside", "Parameter of the link that says who comes",
        "for example PROLIFIC_PID; empty: people come without an id", "text", ANY_TIME,
    ),
    Setting("outside.keep", "outside", "Further parameters to keep", "apart by spaces", "names", ANY_TIME),
    Setting(
        "outside.resume", "outside", "Who comes with a known id", "after having left", "choice", ANY_TIME,
        {
            "anywhere": "goes on, in any browser",
            "same browser": "goes on only in the same browser, or by the resume code",
        },
    ),
    Setting("outside.code", "outside", "Completion code", "of everybody, at the end; empty: none", "text", ANY_TIME),
    Setting(
        "outside.random_codes", "outside", "Random codes", "a completion code for each participant instead", "flag",
        ANY_TIME,
    ),
    Setting(
        "outside.complete_url", "outside", "Address at the end",
        "begins with https://; {id}, {code} and kept names stand for their values; empty: none", "text", ANY_TIME,
    ),
    Setting("outside.screened_out_url", "outside", "Address after screening out", "empty: none", "text", ANY_TIME),
    Setting("outside.no_consent_url", "outside", "Address without consent", "empty: none", "text", ANY_TIME),
    Setting("outside.full_url", "outside", "Address when nobody more is taken in", "empty: none", "text", ANY_TIME),
    Setting(
        "outside.redirect_after_s", "outside", "Seconds until the browser goes there", "0: only by the button", "whole",
        ANY_TIME, low=0, high=600,
    ),
    Setting(
        "limits.finished", "limits", "Most who finish", "those under way count; 0: any number", "whole", ANY_TIME,
        low=0, high=1_000_000,
    ),
    Setting(
        "limits.under_way", "limits", "Most at the same time", "0: any number", "whole", ANY_TIME,
        low=0, high=1_000_000,
    ),
    Setting(
        "limits.open_until", "limits", "Open until",
        "date, time and zone, such as 2027-03-31T18:00+02:00; empty: no end", "text", ANY_TIME,
    ),
    Setting(
        "limits.minutes", "limits", "Minutes each may take", "to the last vote; 0: any time", "whole", ANY_TIME,
        low=0, high=10_080,
    ),
    Setting(
        "abandoned_after_h", "limits", "Hours until a slot is given up",
        "without an answer for so long, an unfinished slot goes to another participant", "number", ANY_TIME,
        low=0.01, high=1_000_000, step="any",
    ),
    Setting(
        "privacy.responsible", "privacy", "Responsible", "for participants’ data: a person or an institution", "text",
        ANY_TIME,
    ),
    Setting("privacy.contact", "privacy", "Contact", "such as an address of mail", "text", ANY_TIME),
    Setting(
        "privacy.keep_days", "privacy", "Days for which personal data are kept",
        "after the study is closed; then answers, screening, outside ids and names on invitations are deleted, and "
        "votes stay; 0: no limit", "whole", ANY_TIME, low=0, high=36_500,
    ),
    Setting("lab_sheet.display", "lab_sheet", "Display", "make and model", "text", ANY_TIME),
    Setting(
        "lab_sheet.size_inch", "lab_sheet", "Size, inch", "its diagonal", "number", ANY_TIME,
        low=1, high=500, step="any", may_be_empty=True,
    ),
    Setting(
        "lab_sheet.peak_luminance_cd_m2", "lab_sheet", "Peak luminance, cd/m²", "of its white", "number", ANY_TIME,
        low=1, high=10_000, step="any", may_be_empty=True,
    ),
    Setting("lab_sheet.white_point", "lab_sheet", "White point", "such as 5000 K or D65", "text", ANY_TIME),
    Setting("lab_sheet.room_light", "lab_sheet", "Room light", "such as dark, controlled", "text", ANY_TIME),
    Setting(
        "lab_sheet.distance_cm", "lab_sheet", "Viewing distance, cm", "from eyes to display", "number", ANY_TIME,
        low=10, high=5000, step="any", may_be_empty=True,
    ),
    Setting(
        "random_effects", "analysis", "Random effects", "fit the scores with them, too", "choice", ANY_TIME,
        choices={
            "": "none",
            "participants": "participants: how people at large would vote",
            "participants,datasets": "participants and datasets: on datasets like these, too",
        },
    ),
)  # fmt: skip

CHANGES: Mapping[str, Change] = {**ELSEWHERE, **{setting.option: setting.change for setting in SETTINGS}}


def why_fixed(change: Change, *, has_begun: bool, has_stimuli: bool) -> str:
    """Say why a setting cannot change now; empty: it can.

    Parameters
    ----------
    change : when it may change
    has_begun : has a participant begun?
    has_stimuli : is the study's stimulus set there, to make films of?
    """
    if change != ANY_TIME and has_begun:
        return "participants have begun, and all of them see the same study; duplicate it to change more"
    if change == WITH_FILMS and not has_stimuli:
        return (
            "the films would have to be made again, and the study’s stimulus set is not on this server; upload it "
            "under Stimulus sets, or create a new study"
        )
    return ""
