"""Join the scripts and the style sheets of the participant's page to one file each: a slow line brings them at once.

The modules in `static/js` stay as they are written: each becomes a function here, in the order in which they need each
other. An address holds the digest of its content, so browsers keep it for good.
"""

from __future__ import annotations

import gzip
import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache

from fastapi import APIRouter, Request
from fastapi.responses import Response

from app.errors import NotFoundError
from app.files import packaged

SCRIPT, STYLES = "participant.js", "participant.css"
STYLE_SHEETS = ("tokens", "base", "participant", "participant-trial", "participant-screening")
IMPORT = re.compile(r'^import \{ ([\w, ]+) \} from "\./([\w-]+\.js)";\n', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
OTHER = re.compile(r"^(import|export)\b.*", re.MULTILINE)
COMMENT = re.compile(r"^[ \t]*/\*(?:[^*]|\*(?!/))*\*/[ \t]*\n", re.MULTILINE)  # on lines of its own
FOR_GOOD = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True)
class Joined:
    """A file made of several."""

    content: bytes
    media_type: str

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.content).hexdigest()[:16]


@cache
def joined_files() -> Mapping[str, Joined]:
    """Return the joined files by name."""
    return {
        SCRIPT: Joined(joined_modules(SCRIPT).encode(), "text/javascript"),
        STYLES: Joined(_styles().encode(), "text/css"),
    }


def joined_address(name: str) -> str:
    """Return the address of a joined file, which changes with its content."""
    return f"/static/joined/{joined_files()[name].digest}/{name}"


@router.get("/static/joined/{digest}/{name}")
def joined_file(digest: str, name: str, request: Request) -> Response:
    """Send a joined file; to a page from before an update the present one, which is then not kept."""
    file = joined_files().get(name)
    if file is None:
        raise NotFoundError("There is no such file.")
    headers = {"Cache-Control": FOR_GOOD if digest == file.digest else "no-cache"}
    return compressed(request, Response(file.content, media_type=file.media_type, headers=headers))


def compressed(request: Request, answer: Response) -> Response:
    """Compress an answer for a browser that takes it."""
    answer.headers["Vary"] = "Accept-Encoding"
    if "gzip" in request.headers.get("accept-encoding", ""):
        answer.body = _gzip(bytes(answer.body))
        answer.headers["Content-Encoding"] = "gzip"
        answer.headers["Content-Length"] = str(len(answer.body))
    return answer


@lru_cache(maxsize=8)
def _gzip(content: bytes) -> bytes:
    return gzip.compress(content, mtime=0)


def joined_modules(entry: str) -> str:
    """Join a module with all that it imports.

    Parameters
    ----------
    entry : file name in static/js; it may await, and exports nothing

    Raises
    ------
    ValueError
        If a module imports or exports in another way than `import { a, b } from "./name.js"` and `export function`,
        `class` or `const`, or if modules import each other in a circle.
    """
    ready: set[str] = set()
    parts = list(_in_order(entry, ready, ()))
    return "const modules = {};\n" + "".join(parts)


def _in_order(name: str, ready: set[str], above: tuple[str, ...]) -> Iterator[str]:
    """Yield the parts of a module: first those that it needs and that are not yet there, then its own."""
    if name in above:
        raise ValueError(f"{' imports '.join((*above, name))}: expected no circle")
    if name in ready:
        return
    source = (packaged("static") / "js" / name).read_text(encoding="utf-8")
    for _, needed in IMPORT.findall(source):
        yield from _in_order(needed, ready, (*above, name))
    ready.add(name)
    yield _part(name, source, is_entry=not above)


def _part(name: str, source: str, *, is_entry: bool) -> str:
    exported = EXPORT.findall(source)
    code = IMPORT.sub(r'const { \1 } = modules["\2"];\n', EXPORT.sub("", COMMENT.sub("", source)))
    if other := OTHER.search(code):
        raise ValueError(f"{name}: {other.group()!r} cannot be joined; expected imports and exports of names")
    if is_entry:
        return f"// {name}\n{code}"
    return f'modules["{name}"] = (() => {{ // {name}\n{code}return {{ {", ".join(exported)} }};\n}})();\n'


def _styles() -> str:
    folder = packaged("static") / "css"
    return "".join(COMMENT.sub("", (folder / f"{name}.css").read_text(encoding="utf-8")) for name in STYLE_SHEETS)
