"""List every setting of a study as a form shows it: those of its own columns, and those that its options declare."""

from __future__ import annotations

from collections.abc import Mapping

from app.study.option_fields import ANY_TIME, WITH_FILMS, Change, settings_of
from app.study.options.options import StudyOptions
from app.study.options.study_file import StudyFile

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
_OF_COLUMNS = (setting for setting in settings_of(StudyFile) if setting.name in COLUMNS)
_ALL = (*_OF_COLUMNS, *settings_of(StudyOptions))
# In the order of the form; those of no section have a page of their own: the study's Texts, and its Invitations.
SETTINGS = tuple(setting for section in SECTIONS for setting in _ALL if setting.section == section)
SETTINGS_BY_NAME = {setting.name: setting for setting in SETTINGS}
CHANGES: Mapping[str, Change] = {setting.option: setting.change for setting in _ALL}


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
