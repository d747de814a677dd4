"""The participant's pages: the entrance, and the page that leads from Begin to the thanks.

The page's script shows the trials, through the session API. A page says nothing about what is compared.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Annotated

from fastapi import APIRouter, Depends, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.errors import InvalidError, NotFoundError
from app.films.strips import MEDIA_TYPES
from app.store.participants.invitations import invitation_of_session
from app.store.studies.studies import study_by_id
from app.store.trials.admission import begin_preview
from app.store.trials.deletion import forget_preview_votes
from app.store.trials.sessions import resume_session, session_by_token
from app.study.languages.language_pack import LanguagePack, nested_texts
from app.study.options.privacy import collected
from app.study.options.stage_data import consent_to_send
from app.study.options.wording import offered_languages, wording
from app.web.form_token import has_form_token, is_own_form, own_form, page_with_form
from app.web.gates import (
    PARTICIPANT_COOKIE,
    Now,
    Store,
    address,
    cookie,
    delete_cookie,
    languages,
    note_refusal,
    set_cookie,
    throttle,
)
from app.web.limits.throttle import WRONG_CODES
from app.web.markdown import render_markdown
from app.web.participant.beginning import remember
from app.web.participant.entrance import Entrance, entrance, see_invitation
from app.web.participant.joined import compressed, joined_address

DEFAULT_LANGUAGE = "en"
LANGUAGE_COOKIE = "language"
LEAVE = "leave"  # in place of a stage: the end of a preview
STATUS_OF_MESSAGE = {
    "unknown": 404,
    "unknown_resume_code": 404,
    "used": 410,
    "paused": 403,
    "closed": 403,
    "full": 403,
    "bad_link": 422,
    "begun_elsewhere": 409,
}

log = logging.getLogger(__name__)
router = APIRouter(include_in_schema=False)


@router.get("/")
def entrance_page(request: Request, code: str = "") -> Response:
    if code.strip():
        return see_invitation(code)
    return _page(request, "participant/entrance.html", keeps_cookies=True)


@router.get("/s/{code}")
def participant_page(request: Request, code: str, another: str = "") -> Response:
    throttle(request).check(WRONG_CODES, address(request))
    study = entrance(request, code, is_for_another=bool(another))
    state = study.state if study else "unknown"
    if study is None:
        throttle(request).count(WRONG_CODES, address(request))
    offered = _offered(request, study)
    if study is None or state in STATUS_OF_MESSAGE or not offered:
        state = state if state in STATUS_OF_MESSAGE else "paused"
        log.warning(
            "an invitation's page was refused: %s", state if offered else "the study is complete in no language"
        )
        note_refusal(request, "not found" if state == "unknown" else "not taken in", f"invitation {state}")
        leads_to = study.full_url if study is not None and state in ("paused", "closed", "full", "used") else ""
        status = STATUS_OF_MESSAGE[state]
        return _page(
            request,
            "participant/message.html",
            status,
            offered,
            message=state,
            leads_to=leads_to,
            person=_person(code, study),
        )
    language = study.language or ""
    language = language if language in offered else _language(request, offered)
    shown = wording(offered[language], study.options, study.title, study.images)
    page = _page(
        request,
        "participant/study.html",
        200,
        {language: offered[language]} if study.language else offered,
        texts=shown.texts,
        texts_sha256=shown.sha256,
        consent=consent_to_send(study.options, language),
        markdown=render_markdown,
        study=study,
        code=code,
        person=_person(code, study),
        second_type=MEDIA_TYPES.get(study.options.second_codec),
        joined=joined_address,
    )
    return compressed(request, page)


def _person(code: str, study: Entrance | None) -> str:
    """Name whom a browser may have kept a code of: the invitation, and the id that a platform's link gives."""
    return " ".join([code, *list(study.outside.values() if study else ())[:1]])


@router.get("/s/{code}/privacy")
def privacy_page(request: Request, code: str) -> Response:
    """Say what the study of an invitation does with participants' data, also after it is closed."""
    throttle(request).check(WRONG_CODES, address(request))
    study = entrance(request, code)
    offered = _offered(request, study) if study else {}
    if study is None or not offered:
        throttle(request).count(WRONG_CODES, address(request))
        return _page(request, "participant/message.html", 404, message="unknown", leads_to="")
    language = _language(request, offered)
    shown = wording(offered[language], study.options, study.title)
    return _page(
        request,
        "participant/privacy.html",
        200,
        offered,
        texts=shown.texts,
        options=study.options,
        collected=collected(study.options, is_named=study.is_named),
    )


def _offered(request: Request, study: Entrance | None) -> Mapping[str, LanguagePack]:
    """Return the packs that a page can be shown in: the study's; else the reviewed ones and one chosen before."""
    packs = languages(request)
    if study is not None:
        return {tag: packs[tag] for tag in offered_languages(study.options, packs)}
    chosen = _chosen(request)
    return {tag: pack for tag, pack in packs.items() if pack.status == "reviewed" or tag in chosen}


@router.post("/s/{code}/preview", dependencies=[Depends(own_form)])
def steer_preview(
    request: Request, code: str, stage: Annotated[str, Form(max_length=40)], database: Store, now: Now
) -> Response:
    """Jump to a stage of a preview, or leave it (LEAVE); what was entered so far is forgotten.

    The preview's own cookie says that an experimenter asks: nobody else holds one.
    """
    token = cookie(request, PARTICIPANT_COOKIE) or ""
    with database.reading() as connection:
        session = session_by_token(connection, token)
        study = study_by_id(connection, session.study_id) if session and session.is_preview else None
    if session is None or study is None:
        raise NotFoundError("There is no preview in this browser. Begin one from the study's page.")
    if stage == LEAVE:
        with database.writing() as connection:
            forget_preview_votes(connection, study.id)
        answer = RedirectResponse(f"/admin/studies/{study.slug}", status_code=303)
        delete_cookie(request, answer, PARTICIPANT_COOKIE)
        return answer
    if stage not in session.options.way:
        raise InvalidError(f"The study has no stage {stage!r}; expected one of {', '.join(session.options.way)}.")
    answer = see_invitation(code)
    remember(request, answer, begin_preview(database, study, now, stage))
    return answer


@router.post("/resume")
def resume_elsewhere(
    request: Request,
    resume_code: Annotated[str, Form(max_length=40)],
    database: Store,
    form_token: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Resume a session in this browser; sending the form twice does no harm."""
    if not is_own_form(request, form_token):
        log.warning("a resume code came from elsewhere than the entrance's form")
        return _page(request, "participant/entrance.html", 403, keeps_cookies=has_form_token(request))
    throttle(request).check(WRONG_CODES, address(request))
    token = resume_session(database, resume_code, form_token)
    if token is None:
        throttle(request).count(WRONG_CODES, address(request))
        message = "unknown_resume_code"
        log.warning("a resume code is not known")
        return _page(request, "participant/message.html", STATUS_OF_MESSAGE[message], message=message, leads_to="")
    with database.reading() as connection:
        invitation = invitation_of_session(connection, token)
    assert invitation is not None, "every session was begun with one"
    answer = see_invitation(invitation)
    remember(request, answer, token)
    return answer


def _page(
    request: Request,
    template: str,
    status_code: int = 200,
    offered: Mapping[str, LanguagePack] | None = None,
    **context: object,
) -> Response:
    """Render a page in the reader's language.

    Parameters
    ----------
    offered : packs to choose from; None or none: those of pages that belong to no study
    """
    packs = offered or _offered(request, None)
    language = _language(request, packs)
    page = page_with_form(
        request,
        template,
        {
            "language": language,
            "direction": packs[language].direction,
            "languages": {tag: pack.name for tag, pack in packs.items()},
            "texts": nested_texts(packs[language].texts),
            "person": "",
            **context,
        },
        status_code,
        headers={"Cache-Control": "no-store"},  # the page changes with the invitation's state
    )
    if request.query_params.get("language") == language:
        set_cookie(request, page, LANGUAGE_COOKIE, language)
    return page


def _language(request: Request, offered: Mapping[str, LanguagePack]) -> str:
    """Return the language that was chosen by hand, now or before, else the browser's, else the first offered."""
    chosen = next((tag for tag in _chosen(request) if tag in offered), None)
    return chosen or preferred_language(request.headers.get("accept-language", ""), list(offered))


def _chosen(request: Request) -> list[str]:
    chosen = (request.query_params.get("language"), cookie(request, LANGUAGE_COOKIE))
    return [tag for tag in chosen if tag is not None]


def preferred_language(accepted: str, offered: Sequence[str]) -> str:
    """Return the first offered language of an Accept-Language header by falling weight, else English or the first.

    A regional variant stands for its language where it is not offered itself: de-AT for de, zh-CN for zh.
    """
    weighted = [_weighted(entry) for entry in accepted.split(",") if entry.strip()]
    acceptable = sorted((entry for entry in weighted if entry[0] > 0), key=lambda entry: -entry[0])
    by_lower = {tag.lower(): tag for tag in offered}
    for _, wanted in acceptable:
        if tag := by_lower.get(wanted) or by_lower.get(wanted.split("-")[0]):
            return tag
    return DEFAULT_LANGUAGE if DEFAULT_LANGUAGE in offered else offered[0]


def _weighted(entry: str) -> tuple[float, str]:
    tag, _, weight = entry.partition(";")
    try:
        quality = float(weight.strip().removeprefix("q=") or 1)
    except ValueError:
        quality = 0.0
    return quality, tag.strip().lower()
