"""Edit a study's own texts in each language, in place of those of the language's pack."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from fastapi import APIRouter, File, Form, Path, Request, UploadFile
from fastapi.responses import Response

from app.errors import ConflictError, InvalidError, NotFoundError
from app.operations.studies.edit import keep_study_image, remove_study_image
from app.operations.studies.manage import study_file_of
from app.store.access.experimenters import Experimenter
from app.store.studies.images import image_digests
from app.store.studies.studies import Study, progress_of, study_by_id
from app.study.languages.language_pack import BY, PLURALS, LanguagePack, Text
from app.study.options.options import StudyOptions, parse_options
from app.study.options.own_texts import CONSENT, DEBRIEFING, LONGEST_TEXT, NAME
from app.study.options.wording import (
    changed_languages,
    first_language,
    own_texts,
    protocol_texts,
    refused_languages,
    wording,
)
from app.study.questions.answers import QUESTIONS, pack_labels
from app.study.trial.image import LARGEST_IMAGE
from app.web.admin.layout import see, study_page, unix
from app.web.admin.studies.edit_page import Revision, save_study
from app.web.admin.studies.form import Merged, digests_of, merged
from app.web.gates import Store, database, languages
from app.web.markdown import render_markdown
from app.web.roles import Acting, AStudy, Looking

PLAIN = {CONSENT: "consent", DEBRIEFING: "debriefing"}  # options that hold the texts of the study's first language
LABELS = {
    NAME: "Name of the study",
    CONSENT: "Consent",
    DEBRIEFING: "Debriefing",
}  # the page calls others by their keys
LONGEST_DIGESTS = 100_000  # characters of what a page says that its texts were; 300 texts take 10 000

router = APIRouter(prefix="/admin/studies/{slug}/texts", include_in_schema=False)

Tag = Annotated[str, Form(max_length=40)]
Texts = Annotated[list[Annotated[str, Form(max_length=2 * LONGEST_TEXT)]], Form()]


@dataclass(frozen=True)
class Row:
    """A text in the page's table: what participants read without the study's own, and the study's own."""

    key: str
    default: str
    said: str


@router.get("")
def texts_page(request: Request, person: Looking, study: AStudy, language: str = "") -> Response:
    return _page(request, person, study, language)


def _page(request: Request, person: Experimenter, study: Study, language: str, mine: Merged | None = None) -> Response:
    """Show the texts in a language; `mine`: as somebody has typed them while somebody else has saved others."""
    packs, options = languages(request), parse_options(study.options)
    with database(request).reading() as connection:
        has_begun = progress_of(connection, study.id).n_started > 0
        images = image_digests(connection, study.id)
    refusals = refused_languages(options, packs)
    chosen = packs.get(language or first_language(options)) or packs[next(iter(packs))]
    saved = _said(options, chosen)
    said = mine.values if mine else saved
    groups: dict[str, list[Row]] = {}
    for row in _rows(options, chosen):
        groups.setdefault(row.key.partition(".")[0], []).append(replace(row, said=said[row.key]))
    context = {
        "packs": packs,
        "listed_packs": _listed_packs(packs),
        "pack": chosen,
        "refusals": refusals,
        "named": " ".join(options.languages),
        "first": first_language(options),
        "groups": groups,
        "labels": LABELS,
        "documents": {key: said[key] for key in PLAIN},
        "markdown": render_markdown,
        "images": images,
        "largest_image_kb": LARGEST_IMAGE // 1024,
        "name": said[NAME],
        "was": digests_of(saved),
        "clashes": mine.clashes if mine else (),
        "others": mine.others if mine else (),
        "longest_text": LONGEST_TEXT,
        "has_begun": has_begun,
        "sha256": wording(chosen, options, study.name, images).sha256 if refusals.get(chosen.tag) == "" else "",
    }
    return study_page(request, "texts", person, study, context, 409 if mine else 200)


def _listed_packs(packs: Mapping[str, LanguagePack]) -> str:
    return ", ".join(f"{tag} ({pack.name})" for tag, pack in packs.items())


@router.post("/languages")
def choose_languages(
    request: Request,
    actor: Acting,
    study: AStudy,
    revision: Revision,
    named: Annotated[str, Form(max_length=500)] = "",
) -> Response:
    """Save in which languages the study is offered."""
    packs = languages(request)
    tag_of = {word.casefold(): tag for tag, pack in packs.items() for word in (tag, pack.name)}
    words = named.replace(",", " ").split()
    if unknown := [word for word in words if word.casefold() not in tag_of]:
        raise InvalidError(
            f"Nothing was changed: {unknown[0]} is no language here; expected some of {_listed_packs(packs)}."
        )
    try:
        tags = StudyOptions.read({"languages": [tag_of[word.casefold()] for word in words]}).languages
        changes = changed_languages(parse_options(study.options), tags)
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    return _save(request, actor, study, revision, changes, "texts")


@router.post("")
def save_texts(
    request: Request,
    person: Looking,
    actor: Acting,
    study: AStudy,
    revision: Revision,
    language: Tag,
    key: Texts,
    said: Texts,
    was: Annotated[str, Form(max_length=LONGEST_DIGESTS)] = "",
) -> Response:
    """Save the study's own texts in a language; an empty one goes back to the pack's."""
    pack = languages(request).get(language)
    if pack is None:
        raise NotFoundError("There is no such language.")
    if len(key) != len(said):
        raise InvalidError(f"{len(said)} texts came with {len(key)} keys; please load the page again.")
    options = parse_options(study.options)
    given = {name: unix(text) for name, text in zip(key, said, strict=True)}
    typed = dict(given)
    changes: dict[str, Any] = {}
    if language == first_language(options):
        changes = {option: given.pop(name, "") for name, option in PLAIN.items()}
    texts = {name: _parsed(name, text, pack) for name, text in given.items() if text}
    changes["texts"] = {**options.texts, language: texts}
    try:
        return _save(request, actor, study, revision, changes, f"texts?language={language}")
    except ConflictError:
        with database(request).reading() as connection:
            now = study_by_id(connection, study.id)
        if now is None or now.revision == revision:
            raise
        saved = _said(parse_options(now.options), pack)
        mine = merged(was, typed, saved, {name: LABELS.get(name, name) for name in saved})
        return _page(request, person, now, language, mine)


@router.post("/images")
def upload_image(actor: Acting, study: AStudy, database: Store, image: Annotated[UploadFile, File()]) -> Response:
    """Keep an image, in place of one of the same name, for texts to show."""
    keep_study_image(database, study, image.filename or "", image.file.read(LARGEST_IMAGE + 1), actor)
    return see(f"/admin/studies/{study.slug}/texts")


@router.post("/images/{name}/remove")
def remove(actor: Acting, study: AStudy, database: Store, name: Annotated[str, Path(max_length=80)]) -> Response:
    remove_study_image(database, study, name, actor)
    return see(f"/admin/studies/{study.slug}/texts")


def _save(
    request: Request,
    actor: Acting,
    study: AStudy,
    revision: int,
    changes: Mapping[str, Any],
    page: str,
) -> Response:
    now = study_file_of(study)
    try:
        wanted = now.but(options=parse_options({**now.options.as_json(), **changes}))
    except ValueError as error:
        raise InvalidError(f"Nothing was changed: {error}.") from error
    return save_study(request, study, wanted, revision, actor, page)


def _rows(options: StudyOptions, pack: LanguagePack) -> Iterator[Row]:
    """Yield all texts but the documents and the name; at the end the questions."""
    plain = own_texts(options.but(texts={}), pack.tag)
    said = options.texts.get(pack.tag, {})
    for key, text in protocol_texts(pack, options.protocol).items():
        yield Row(key, _written(text), _written(said.get(key, "")))
    for question in options.questions:
        text, labels = (f"{QUESTIONS}.{question.name}.{part}" for part in ("text", "labels"))
        yield Row(text, _written(plain.get(text) or pack.texts.get(text, "")), _written(said.get(text, "")))
        if question.kind in ("choice", "scale"):
            default = plain.get(labels) or pack_labels(question, pack.texts)
            yield Row(labels, _written(default), _written(said.get(labels, "")))


def _said(options: StudyOptions, pack: LanguagePack) -> dict[str, str]:
    """Return the study's own texts in a language as the page edits them, by key."""
    texts = own_texts(options, pack.tag)
    plain = {key: str(texts.get(key, "")) for key in LABELS}
    return {**plain, **{row.key: row.said for row in _rows(options, pack)}}


def _written(text: Text) -> str:
    """Write a text as the page edits it: a list line by line, a plural text with a form in each line."""
    if isinstance(text, dict):
        return "\n".join(f"{form}: {words}" for form, words in text.items() if form != BY)
    return "\n".join(text) if isinstance(text, list) else text


def _parsed(key: str, written: str, pack: LanguagePack) -> Text:
    """Read a text as `_written` writes it."""
    default = pack.texts.get(key)
    lines = [line.strip() for line in written.splitlines() if line.strip()]
    if isinstance(default, list) or key.endswith(".labels"):
        return lines
    forms = [line.partition(": ") for line in lines]
    if isinstance(default, dict) and all(form in PLURALS for form, _, _ in forms):
        return {BY: default[BY], **{form: words for form, _, words in forms}}
    return written
