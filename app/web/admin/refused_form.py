"""Show a refused form again, as it was sent: the page from which it came, filled with what was typed."""

from __future__ import annotations

import html
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from html.parser import HTMLParser
from urllib.parse import urlsplit

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, Response
from starlette.exceptions import HTTPException
from starlette.types import Message

from app.errors import StudyError
from app.web.markdown import with_code
from app.web.problems import DASHBOARD, SECRET, Typed, typed_fields

REFUSED = (409, 422)  # statuses of a form that asks for what cannot be done, to be corrected
NEVER_TYPED = ("hidden", "submit", "button", "reset", "file", "password")  # types of inputs that keep the page's value


async def form_again(request: Request, status: int, detail: str) -> Response | None:
    """Answer with the page from which a refused form came, filled as it was sent; None where that cannot be."""
    came_from = urlsplit(request.headers.get("referer", ""))
    fields = await typed_fields(request) if status in REFUSED and came_from.path.startswith(DASHBOARD) else ()
    if not fields:
        return None
    page = await _page_at(request, came_from.path, came_from.query)
    filled = fill_form(page, request.url.path, fields, detail) if page else None
    return HTMLResponse(filled, status) if filled else None


async def _page_at(request: Request, path: str, query: str) -> str | None:
    """Return another page as this person sees it; None where there is none."""
    headers = [(name, value) for name, value in request.scope["headers"] if not name.startswith(b"content-")]
    scope = dict(request.scope) | {"method": "GET", "path": path, "raw_path": path.encode(), "headers": headers}
    scope |= {"query_string": query.encode(), "path_params": {}, "state": dict(request.scope["state"])}
    status, parts = 0, []

    async def receive() -> Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Message) -> None:
        nonlocal status
        status = message.get("status", status)
        parts.append(message.get("body", b""))

    try:
        await request.app.router(scope, receive, send)
    except (StudyError, HTTPException, RequestValidationError):
        return None
    return b"".join(parts).decode() if status == 200 else None


def fill_form(page: str, action: str, typed: Typed, message: str) -> str | None:
    """Return a page with the message on top and the form filled; None if the page has no such form.

    Parameters
    ----------
    page : HTML as our templates write it
    action : the address to which the form was sent
    typed : its fields in order; a name may come more than once
    message : why it was refused
    """
    forms = _Forms()
    forms.feed(page)
    wanted = _by_name((name, value) for name, value in typed if name not in SECRET)
    for number, (address, hidden) in enumerate(forms.found):
        if address == action and all(wanted.get(name, [])[: len(values)] == values for name, values in hidden.items()):
            filler = _Filler(number, typed, message)
            filler.feed(page)
            filler.close()
            return "".join(filler.parts)
    return None


def _by_name(fields: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    values = defaultdict(list)
    for name, value in fields:
        values[name].append(value)
    return dict(values)


class _Forms(HTMLParser):
    """The forms of a page, each with its address and its hidden fields, which tell forms of one address apart."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, list[str]]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "form":
            self.found.append((given.get("action") or "", {}))
        elif tag == "input" and given.get("type") == "hidden" and self.found and given.get("name") not in SECRET:
            self.found[-1][1].setdefault(given.get("name") or "", []).append(given.get("value") or "")


class _Filler(HTMLParser):
    """Copies a page as it is, but for the fields of one form, and the message at the beginning of its content."""

    def __init__(self, number: int, typed: Typed, message: str) -> None:
        super().__init__(convert_charrefs=False)
        self.parts: list[str] = []
        self._forms_left = number + 1
        self._is_inside = False
        self._values = _by_name(typed)
        self._next = {name: deque(values) for name, values in self._values.items()}
        self._message = message
        self._select: str | None = None  # the value to choose, inside a select of the form
        self._is_replaced = False  # inside a textarea of the form: its old text is left out

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "form":
            self._forms_left -= 1
            self._is_inside = self._forms_left == 0
        is_field = self._is_inside and given.get("name") not in (None, *SECRET) and "disabled" not in given
        if tag == "input" and is_field:
            self._fill_input(given)
        elif tag == "select" and is_field:
            self._select = self._take(given)
            self._copy()
        elif tag == "option" and self._select is not None:
            self._fill_option(given)
        else:
            self._copy()
        if tag == "textarea" and is_field:
            self.parts.append("\n" + html.escape(self._take(given) or ""))
            self._is_replaced = True
        if tag == "main":
            self.parts.append(f'<p class="warning" id="refused" role="alert">{with_code(self._message)}</p>')

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:  # noqa: ARG002 (the base's)
        self._copy()

    def handle_endtag(self, tag: str) -> None:
        if tag == "form":
            self._is_inside = False
        elif tag == "select":
            self._select = None
        elif tag == "textarea":
            self._is_replaced = False
        self.parts.append(f"</{tag}>")

    def handle_data(self, data: str) -> None:
        if not self._is_replaced:
            self.parts.append(data)

    def handle_entityref(self, name: str) -> None:
        self.handle_data(f"&{name};")

    def handle_charref(self, name: str) -> None:
        self.handle_data(f"&#{name};")

    def handle_decl(self, decl: str) -> None:
        self.parts.append(f"<!{decl}>")

    def _fill_input(self, given: Mapping[str, str | None]) -> None:
        kind = given.get("type") or "text"
        if kind in ("checkbox", "radio"):
            is_on = (given.get("value") or "on") in self._values.get(given["name"] or "", ())
            self._write("input", {**_without(given, "checked"), **({"checked": None} if is_on else {})})
            return
        value = self._take(given)
        if kind in NEVER_TYPED or value is None:
            self._copy()
        else:
            self._write("input", {**given, "value": value})

    def _fill_option(self, given: Mapping[str, str | None]) -> None:
        """Choose an option by its value, which our templates always write."""
        is_chosen = given.get("value") == self._select
        self._write("option", {**_without(given, "selected"), **({"selected": None} if is_chosen else {})})

    def _take(self, given: Mapping[str, str | None]) -> str | None:
        """Return what was typed into the next field of this name."""
        left = self._next.get(given["name"] or "")
        return left.popleft() if left else None

    def _copy(self) -> None:
        self.parts.append(self.get_starttag_text() or "")

    def _write(self, tag: str, given: Mapping[str, str | None]) -> None:
        attributes = (name if value is None else f'{name}="{html.escape(value)}"' for name, value in given.items())
        self.parts.append(f"<{' '.join([tag, *attributes])}>")


def _without(given: Mapping[str, str | None], name: str) -> dict[str, str | None]:
    return {key: value for key, value in given.items() if key != name}
