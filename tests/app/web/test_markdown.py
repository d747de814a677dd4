from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.web.markdown import render_markdown

ALLOWED = re.compile(
    r"</?(p|h[2-6]|ul|ol( start=\"\d+\")?|li|strong|em|blockquote|pre|code|a)>|<(br|hr) />"
    r'|<code class="language-[^"<>]*">'
    r'|<a href="(https?://|mailto:)[^"<>]*"( title="[^"<>]*")? target="_blank" rel="noopener noreferrer">'
    r'|<a title="[^"<>]*">|<img src="/images/1" alt="[^"<>]*">',
    re.IGNORECASE,
)
PIECES = (
    "<script>|</p>|<img src=x onerror=y>|[a](|![a](|javascript:x|JAVASCRIPT&#58;x|data:text/html,x|https://a.b|"
    'https://a.b"onclick=x|me.png|)|`|**|_|# |- |1. |> |"|vbscript:x|//a.b|&lt;|\\|<javascript:x>|    |```'
)
pieces = st.sampled_from([*PIECES.split("|"), "\n", "\n\n", "[a]: javascript:x\n", "\t", "\0"])


@given(st.lists(pieces | st.text(max_size=8), max_size=12).map("".join))
def test_no_text_makes_a_tag_or_an_address_beyond_the_few_allowed(text: str) -> None:
    html = str(render_markdown(text, {"me.png": "1"}))
    assert "<" not in ALLOWED.sub("", html)


@pytest.mark.parametrize("address", ["javascript:alert(1)", "JaVaScRiPt:alert(1)", "data:text/html,x", "vbscript:x"])
def test_a_script_is_no_link(address: str) -> None:
    assert "href" not in render_markdown(f"[here]({address}) <{address}> ![here]({address})")


def test_lists_emphasis_headings_and_links_are_rendered_and_links_open_in_a_new_tab() -> None:
    assert str(render_markdown("# Data\n\n- a\n- **b**\n\n[more](https://a.b/c)")) == (
        "<h2>Data</h2>\n<ul>\n<li>a</li>\n<li><strong>b</strong></li>\n</ul>\n"
        '<p><a href="https://a.b/c" target="_blank" rel="noopener noreferrer">more</a></p>\n'
    )


def test_a_plain_text_keeps_its_paragraphs_and_shows_html_as_it_was_written() -> None:
    text = "We compare <b>models</b> & films.\nOne line more.\n\n    You may stop."
    assert str(render_markdown(text)) == (
        "<p>We compare &lt;b&gt;models&lt;/b&gt; &amp; films.\nOne line more.</p>\n<p>You may stop.</p>\n"
    )


def test_only_an_image_of_the_study_is_shown_another_leaves_its_description() -> None:
    html = str(render_markdown('![A "room"](me.png) ![the lab](https://a.b/lab.png)', {"me.png": "1"}))
    assert html == '<p><img src="/images/1" alt="A &#34;room&#34;"> the lab</p>\n'
