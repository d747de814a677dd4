"""The page of a report says what it is given, and nothing in it becomes markup by accident."""

from __future__ import annotations

from pathlib import Path

from recon.validation.page import Section, write_page


def test_words_are_escaped_and_drawings_are_not(tmp_path: Path) -> None:
    drawing = '<?xml version="1.0"?>\n<svg width="9"><rect/></svg>'
    rows = [{"n_samples": 12345, "sensor": "<S1>", "mean_mm": 0.25}, {"sensor": None, "is_sound": True}]
    sections = [Section("A & B", "x < y", rows, [('"Drawn"', drawing), ("Seen", b"\x89PNG")])]
    page = write_page(tmp_path / "report.html", "<b>Title</b>", sections).read_text(encoding="utf-8")
    assert "<h1>&lt;b&gt;Title&lt;/b&gt;</h1>" in page
    assert "<h2>A &amp; B</h2>\n<p>x &lt; y</p>" in page
    assert '<th scope="col">samples</th>\n<th scope="col" class="words">sensor</th>' in page
    assert '<td>12\u202f345</td>\n<td class="words">&lt;S1&gt;</td>\n<td>0.25</td>\n<td>–</td>' in page
    assert '<figure>\n<svg width="9"><rect/></svg>\n<figcaption>&#34;Drawn&#34;</figcaption>' in page
    assert '<img alt="Seen" src="data:image/png;base64,iVBORw==">' in page


def test_long_paths_break_between_folders(tmp_path: Path) -> None:
    page = write_page(tmp_path / "report.html", "Clouds", [Section("Files", rows=[{"file": "run/<a>/0000.ply"}])])
    assert '<td class="words">run/<wbr>&lt;a&gt;/<wbr>0000.ply</td>' in page.read_text(encoding="utf-8")
