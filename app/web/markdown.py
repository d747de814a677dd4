"""Render Markdown as safe HTML, of a study's texts and of the manual: no raw HTML, nothing loaded from elsewhere."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from typing import Any

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token
from markupsafe import Markup, escape

from app.study.trial.image import IMAGE_NAME

OUTWARD = re.compile(r"(https?://|mailto:)", re.IGNORECASE)
COMMAND = re.compile(r"`([^`]+)`")
SMALLEST_HEADING = 6


def render_markdown(text: str, images: Mapping[str, str] | None = None) -> Markup:
    """Render a text; links open in a new tab.

    Parameters
    ----------
    text : CommonMark; HTML in it is shown as it is written, indented lines are paragraphs
    images : SHA-256 of the study's images, by name; an image that is not among them leaves its description
    """
    parser = MarkdownIt("commonmark", {"html": False}).disable("code")
    parser.validateLink = _is_allowed  # type: ignore[method-assign]  # the parser's documented way to say what may be linked
    parser.add_render_rule("link_open", _open_link)
    parser.add_render_rule("heading_open", _smaller_heading)
    parser.add_render_rule("heading_close", _smaller_heading)
    parser.add_render_rule("image", _image)
    return Markup(parser.render(text, {"images": images or {}}))


def render_manual(text: str, pages: Container[str]) -> Markup:
    """Render a page of the manual; links to pages that are not `pages` leave their words.

    Its headings have the names that the documentation's other home gives them, so that links to them work here, too.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    parser.add_render_rule("link_open", _open_manual_link)
    parser.add_render_rule("heading_open", _named_heading)
    parser.add_render_rule("image", _manual_image)
    parser.add_render_rule("table_open", lambda *_: '<div class="scroll" tabindex="0" role="group"><table>')
    parser.add_render_rule("table_close", lambda *_: "</table></div>")
    page: str = parser.render(text, {"pages": pages})
    return Markup(page.replace("<pre>", '<pre tabindex="0">'))  # a long line is scrolled by keyboard, too


def heading_name(heading: str) -> str:
    """Return the name by which links lead to a heading of the manual."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading.lower()).strip())


def with_code(sentence: str) -> Markup:
    """Render a sentence of ours whose `commands` stand in backticks; anything else is shown as it is written."""
    return Markup(COMMAND.sub(r"<code>\1</code>", str(escape(sentence))))


def _is_allowed(url: str) -> bool:
    return OUTWARD.match(url) is not None or IMAGE_NAME.fullmatch(url) is not None


def _open_link(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, _env: Any) -> str:
    token = tokens[index]
    if OUTWARD.match(str(token.attrGet("href"))):
        token.attrSet("target", "_blank")
        token.attrSet("rel", "noopener noreferrer")
    else:
        token.attrs.pop("href")  # an image's name: there is no page behind it
    return self.renderToken(tokens, index, options, _env)


def _smaller_heading(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    """Render a heading one step smaller: the page has one above it."""
    token = tokens[index]
    token.tag = f"h{min(int(token.tag[1]) + 1, SMALLEST_HEADING)}"
    return self.renderToken(tokens, index, options, env)


def _open_manual_link(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    token = tokens[index]
    page, hash_sign, place = str(token.attrGet("href")).partition("#")
    name = page.removesuffix(".md")
    if OUTWARD.match(page):
        token.attrSet("target", "_blank")
        token.attrSet("rel", "noopener noreferrer")
    elif not page or (page.endswith(".md") and name in env["pages"]):
        token.attrSet("href", f"{f'/admin/manual/{name}' if page else ''}{hash_sign}{place}")
    else:
        token.attrs.pop("href")  # a page of the documentation that the server does not have
    return self.renderToken(tokens, index, options, env)


def _named_heading(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    words = self.renderInlineAsText(tokens[index + 1].children or [], options, env)
    tokens[index].attrSet("id", heading_name(words))
    return self.renderToken(tokens, index, options, env)


def _manual_image(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    token = tokens[index]
    description = self.renderInlineAsText(token.children, options, env)
    if not (source := re.fullmatch(r"pictures/([\w.-]+)", str(token.attrGet("src")))):
        return str(Markup.escape(description))
    return str(Markup('<img src="/admin/manual/pictures/{}" alt="{}" loading="lazy">').format(source[1], description))


def _image(self: RendererHTML, tokens: Sequence[Token], index: int, options: Any, env: Any) -> str:
    token = tokens[index]
    description = self.renderInlineAsText(token.children, options, env)
    sha256 = env["images"].get(token.attrGet("src"))
    if sha256 is None:
        return str(Markup.escape(description))
    return str(Markup('<img src="/images/{}" alt="{}">').format(sha256, description))
