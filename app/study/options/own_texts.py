"""Read and check a study's own texts: by language, and by the keys of the language packs or keys of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import StringConstraints

from app.study.languages.language_pack import TAG, Text, flat_texts, model_texts, text_faults
from app.study.option_fields import Different, ListOf, SettingError
from app.study.protocols import IN_PROTOCOLS
from app.study.questions.answers import QUESTIONS
from app.study.questions.questionnaire import Question

CONSENT, DEBRIEFING, NAME = "study.consent", "study.debriefing", "study.name"
LONGEST_TEXT = 20_000  # characters of a consent text
LONGEST_NAME = 200  # characters of a study's name

Languages = Annotated[ListOf[Annotated[str, StringConstraints(pattern=f"^{TAG.pattern}$")]], Different]
OwnTexts = Mapping[str, Mapping[str, Any]]  # by language and key


def plain_document(plain: str, texts: dict[str, dict[str, Text]], language: str, key: str) -> str:
    """Take a document in the study's first language out of its own texts: there it is a plain option.

    Parameters
    ----------
    plain : the option
    texts : the study's own, by language; they lose the document
    language : the study's first
    key : CONSENT or DEBRIEFING

    Raises
    ------
    ValueError
        If the option and the texts differ.
    """
    document = str(texts.get(language, {}).pop(key, plain))
    if plain not in ("", document):
        option = key.removeprefix("study.")
        raise SettingError(option, f"and the option {option} differ; leave one out", f"texts.{language}.{key}")
    return document


def flat_own_texts(content: Any) -> dict[str, dict[str, Any]]:
    """Read the option `texts`: by language, nested as in a pack or by dotted keys.

    Raises
    ------
    ValueError
        If it has another form.
    """
    if not isinstance(content, Mapping) or not all(isinstance(texts, Mapping) for texts in content.values()):
        raise SettingError("texts", "expected a table of each language, such as [options.texts.en.trial]", "texts:")
    if unknown := [language for language in content if not TAG.fullmatch(language)]:
        raise SettingError("texts", f"{unknown[0]!r} is no language's tag, expected one such as en or zh", "texts:")
    return {
        language: {key: text.strip() if isinstance(text, str) else text for key, text in flat_texts(texts).items()}
        for language, texts in content.items()
        if texts
    }


def check_own_texts(texts: OwnTexts, questions: Sequence[Question]) -> None:
    """Check a study's own texts, by language, against the language packs and the questions that it asks.

    Raises
    ------
    ValueError
        Naming the language, the key and its fault.
    """
    by_name = {question.name: question for question in questions}
    for language, said in texts.items():
        for key, text in said.items():
            if faults := _faults_of_own(key, text, by_name):
                raise SettingError("texts", faults[0], f"texts.{language}:")


def _faults_of_own(key: str, text: Any, questions: Mapping[str, Question]) -> list[str]:
    group, _, rest = key.partition(".")
    if key in (CONSENT, DEBRIEFING, NAME):
        longest = LONGEST_NAME if key == NAME else LONGEST_TEXT
        is_text = isinstance(text, str) and 0 < len(text.strip()) <= longest
        return [] if is_text else [f"{key}: expected a text of 1 to {longest} characters"]
    if group == QUESTIONS:
        name, _, part = rest.partition(".")
        return _question_faults(key, part, text, questions.get(name))
    if key not in model_texts() or key.startswith(IN_PROTOCOLS):
        return [f"{key!r} is not known; expected a key of the language packs, {CONSENT}, {DEBRIEFING} or {NAME}"]
    if len(str(text)) > LONGEST_TEXT:
        return [f"{key}: expected a text of at most {LONGEST_TEXT} characters"]
    return text_faults(key, text, may_leave_out=True)


def _question_faults(key: str, part: str, text: Any, question: Question | None) -> list[str]:
    if question is None or part not in ("text", "labels"):
        return [f"{key!r} is not known; expected {QUESTIONS}.NAME.text or .labels of a question that the study asks"]
    if part == "text":
        return [] if isinstance(text, str) and text.strip() else [f"{key} is {text!r:.40}, expected the question"]
    n = len(question.options) if question.kind == "choice" else 2
    is_complete = isinstance(text, list) and len(text) == n and all(isinstance(label, str) and label for label in text)
    if question.kind not in ("choice", "scale") or not is_complete:
        of_what = "its options" if question.kind == "choice" else "the two ends of a scale"
        return [f"{key} is {text!r:.60}, expected a list of labels for {of_what}"]
    return []
