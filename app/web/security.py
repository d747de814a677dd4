"""Middleware for every route: security headers, same-origin and size checks, renewed cookies. Pure ASGI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.study.options.own_texts import LONGEST_TEXT
from app.study.options.study_file import LONGEST_FILE
from app.study.questions.questionnaire import LONGEST_ANSWER, LONGEST_QUESTION, MOST_QUESTIONS, MOST_SPOKEN_QUESTIONS
from app.study.stages import INTERVIEW
from app.study.trial.image import LARGEST_IMAGE
from app.web.gates import UPLOAD_PATH
from app.web.problems import problem
from app.web.roles import set_experimenter_cookie

POLICY = (
    "default-src 'self'",
    "img-src 'self' blob:",  # a picture of the screening is fetched and shown from memory
    "object-src 'none'",
    "base-uri 'none'",
    "form-action 'self'",
    "frame-ancestors 'none'",
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
}
PAGE_HEADERS = {  # for HTML only
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
DATA, DATA_POLICY = "/api/", "default-src 'none'; frame-ancestors 'none'"
STATIC = "/static/"
LARGEST_BODY = 256 * 1024  # bytes; a vote with a thousand switches is a quarter of it
LARGEST_LETTER = 12  # bytes of a character beyond 16 bits, escaped as JSON (\ud834\udd1e) or form (%F0%9D%84%9E)
LONG_TEXTS = (  # addresses that take more, and how many characters; a note includes its earlier text
    (re.compile(f"/api/v1/session/stages/{INTERVIEW}"), MOST_QUESTIONS * LONGEST_ANSWER),
    (
        re.compile(rf"/admin/studies/[a-z0-9-]+/participants/[^/]+/{INTERVIEW}"),
        MOST_SPOKEN_QUESTIONS * (LONGEST_QUESTION + 2 * LONGEST_ANSWER),
    ),
    (re.compile(r"/admin/studies/([a-z0-9-]+/edit|new|new/draft)"), 4 * LONGEST_TEXT),  # two documents, and all else
    (re.compile(r"/admin/studies/([a-z0-9-]+/edit|new)/file"), LONGEST_FILE),
    (re.compile(r"/admin/studies/[a-z0-9-]+/texts"), 5 * LONGEST_TEXT),  # two documents, and all of a language pack
    (re.compile(r"/admin/studies/[a-z0-9-]+/texts/images"), LARGEST_IMAGE // LARGEST_LETTER),
    (re.compile(r"/api/v1/studies/[a-z0-9-]+/images/[^/]+"), LARGEST_IMAGE // LARGEST_LETTER),
    (re.compile(r"/api/v1/(drafts/[^/]+|studies(/[a-z0-9-]+(/texts/[^/]+)?)?)"), 5 * LONGEST_TEXT),
)
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")


class SecurityHeaders:
    """Add security headers to every answer, and `no-store` where it does not say how long it may be cached."""

    def __init__(
        self,
        app: ASGIApp,
        is_https: bool = False,
        with_subdomains: bool = False,
        media_origin: str | None = None,
    ) -> None:
        self.app = app
        strict = "max-age=31536000" + ("; includeSubDomains" if with_subdomains else "")
        always = HEADERS | ({"Strict-Transport-Security": strict} if is_https else {})
        of_page = always | PAGE_HEADERS | {"Content-Security-Policy": policy(media_origin)}
        self.of_data = _encoded(always | {"Content-Security-Policy": DATA_POLICY, "Cache-Control": "no-store"})
        self.of_static = _encoded(of_page | {"Cache-Control": "no-cache"})
        self.of_page = _encoded(of_page | {"Cache-Control": "no-store"})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = self._headers_of(scope["path"]).copy()
                for name, _ in message["headers"]:
                    headers.pop(name, None)
                message["headers"] = [*message["headers"], *headers.items()]
            await send(message)

        await self.app(scope, receive, with_headers if scope["type"] == "http" else send)

    def _headers_of(self, path: str) -> dict[bytes, bytes]:
        if path.startswith(DATA):
            return self.of_data
        return self.of_static if path.startswith(STATIC) else self.of_page


def _encoded(headers: Mapping[str, str]) -> dict[bytes, bytes]:
    return {name.lower().encode(): value.encode() for name, value in headers.items()}


def policy(media_origin: str | None) -> str:
    """Return the Content-Security-Policy of pages.

    Parameters
    ----------
    media_origin : another origin that films come from, if any
    """
    elsewhere = f" {media_origin}" if media_origin is not None else ""
    fetched = f"connect-src 'self'{elsewhere}"  # the participant's page fetches films
    played = f"media-src 'self' blob:{elsewhere}"  # and plays them from memory; the dashboard plays them by address
    return "; ".join((*POLICY, fetched, played))


class SameOrigin:
    """Refuse changing requests that a page of another site sends."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["method"] not in SAFE_METHODS and is_foreign(dict(scope["headers"])):
            await problem(403, "This request came from another site.")(scope, receive, send)
        else:
            await self.app(scope, receive, send)


def is_foreign(headers: Mapping[bytes, bytes]) -> bool:
    """Whether a browser says that another origin made the request; programs say nothing and hold no cookies."""
    if (site := headers.get(b"sec-fetch-site")) is not None:
        return site not in (b"same-origin", b"none")
    origin = headers.get(b"origin")
    return origin is not None and urlsplit(origin).netloc != headers.get(b"host")


class RenewedSession:
    """Set the cookie of an experimenter's session where a gate has renewed its token."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_cookie(message: Message) -> None:
            token = scope.get("state", {}).get("renewed_token")
            if message["type"] == "http.response.start" and token is not None:
                answer = Response()
                set_experimenter_cookie(Request(scope), answer, token)
                MutableHeaders(scope=message).append("Set-Cookie", answer.headers["set-cookie"])
            await send(message)

        await self.app(scope, receive, with_cookie if scope["type"] == "http" else send)


class BodyLimit:
    """Refuse bodies larger than any page of ours sends; uploads have limits of their own."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or UPLOAD_PATH.fullmatch(scope["path"]):
            await self.app(scope, receive, send)
            return
        n_received = 0

        async def counted() -> Message:
            nonlocal n_received
            message = await receive()
            n_received += len(message.get("body", b""))
            if n_received > LARGEST_BODY and n_received > _largest_body(scope["path"]):
                raise HTTPException(413)
            return message

        await self.app(scope, counted, send)


def _largest_body(path: str) -> int:
    letters = next((n_letters for address, n_letters in LONG_TEXTS if address.fullmatch(path)), 0)
    return LARGEST_BODY + LARGEST_LETTER * letters
