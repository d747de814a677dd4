"""Figures for print: names whole, widths of a journal's columns, captions that are true, code that draws them."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from app.analysis import AnalysisSettings, analyse, votes_from_rows
from app.analysis.comparisons.comparison import natural_order
from app.analysis.drawing.charts_in_common import (
    FULL,
    PALETTE,
    WIDTHS,
    chart_svg,
    colour_by,
    colours_of,
    drawn_width,
    letters_without_font,
    shapes_of,
    svg_pdf,
    svg_png,
    text_width,
    wrapped,
)
from app.analysis.drawing.figure_code import figure_code, figure_rows
from app.analysis.model.contrasts import holm
from app.analysis.report.figures import drawn_figures, font_warnings, named_charts
from app.analysis.report.score_charts import groups_chart, levels_chart, scores_chart
from app.analysis.report.vote_charts import preference_chart, residual_chart, triads_chart
from app.files import write_json
from tests.app.analysis.test_findings import CLEAR, votes_by

LONG = [f"PatchMatch with fusion before the surface, Poisson depth {number} (表面再構成)" for number in range(30)]


@pytest.fixture(scope="module")
def many() -> dict[str, Any]:
    """Thirty conditions with long names; each is compared with the next three."""
    votes = [
        vote
        for seed in range(27)
        for vote in votes_by({name: 0.3 * place for place, name in enumerate(LONG[seed : seed + 4])}, 3, seed=seed)
    ]
    return analyse(votes_from_rows(votes), AnalysisSettings(by_dataset=False))


@pytest.fixture(scope="module")
def few() -> dict[str, Any]:
    votes = [vote | {"dataset": name} for name in ("box 10", "box 2") for vote in votes_by(CLEAR, 6)]
    ages = {f"p{number}": "young" if number % 2 else "old" for number in range(6)}
    return analyse(votes_from_rows(votes), AnalysisSettings(groups={"age": ages}, order_effect=True))


def texts(svg: str) -> str:
    """All texts of a figure, one after the other."""
    return re.sub(r"\s", "", "".join(re.findall(r">([^<>]+)<", svg)))


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS.values())
def test_thirty_long_names_are_whole_at_both_widths(many: dict[str, Any], width: int) -> None:
    for chart in (scores_chart(many, width=width), preference_chart(many, width=width)):
        svg = chart_svg(chart, width)
        assert "…" not in texts(svg).replace("…than", "").replace("preferred…", "")
        assert all(name.replace(" ", "") in texts(svg) for name in LONG)
        assert width * 0.8 < drawn_width(svg) <= width


def test_a_pdf_is_as_wide_as_the_column(many: dict[str, Any]) -> None:
    svg = chart_svg(scores_chart(many, width=WIDTHS["one"]))
    box = re.search(rb"MediaBox *\[0 0 ([\d.]+)", svg_pdf(svg))
    assert box is not None
    assert float(box[1]) * 25.4 / 72 == pytest.approx(drawn_width(svg) * 25.4 / 96, rel=0.01)
    assert 70 < float(box[1]) * 25.4 / 72 < 90


@pytest.mark.slow
def test_a_png_has_300_dots_in_an_inch_no_transparency_and_the_width_of_the_column(few: dict[str, Any]) -> None:
    for width, most_mm in zip(WIDTHS.values(), (88, 181), strict=True):
        with Image.open(BytesIO(svg_png(chart_svg(scores_chart(few, width=width), width)))) as picture:
            assert picture.mode == "RGB"
            assert [round(dots) for dots in picture.info["dpi"]] == [300, 300]
            assert most_mm * 0.9 < picture.width / 300 * 25.4 <= most_mm + 0.1


def test_what_is_drawn_wider_than_the_column_is_made_smaller(few: dict[str, Any]) -> None:
    assert drawn_width(chart_svg(scores_chart(few, width=FULL), 200)) == pytest.approx(200)


@pytest.mark.slow
def test_a_condition_that_wins_every_vote_is_an_arrow_with_a_legend() -> None:
    votes = [vote | {"dataset": name} for name in ("box", "ball") for vote in votes_by(CLEAR, 6)]
    best = max(CLEAR, key=lambda name: CLEAR[name])
    for vote in votes:
        if best in (vote["item_a"], vote["item_b"]):
            vote["choice"] = "a" if vote["item_a"] == best else "b"
    analysis = analyse(votes_from_rows(votes))
    sides = {row["item"]: row["no_limit"] for row in analysis["scores"] if row["dataset"] == "all"}
    assert sides == dict.fromkeys(CLEAR, "below") | {best: "above"}
    panel = scores_chart(analysis)["hconcat"][0]
    drawn = {row["item"]: row for row in panel["data"]["values"]}
    assert drawn[best]["x"] == drawn[best]["high"] > max(row["x"] for name, row in drawn.items() if name != best)
    assert abs(drawn[best]["x"]) < 10  # not the penalised score, which depends on the penalty
    assert "noupperlimit:alldecidedvotesareforit" in texts(chart_svg(scores_chart(analysis)))


def test_letters_of_datasets_are_corrected_over_all_of_them() -> None:
    abilities = {"a": 0.0, "b": 1.2, "c": 2.0}
    votes = [
        vote | {"dataset": f"d{seed}"}
        for seed in range(6)
        for vote in votes_by(dict.fromkeys(abilities, 0.0) if seed else abilities, 24, seed=seed)
    ]
    analysis = analyse(votes_from_rows(votes))
    pairs = [row for row in analysis["contrasts"] if row["dataset"] != "all"]
    together = holm(np.array([row["p_value"] for row in pairs]))
    assert [row["p_holm_together"] for row in pairs] == pytest.approx(together.tolist())
    assert any(row["p_holm"] < 0.05 <= row["p_holm_together"] for row in pairs)
    letters = {(row["dataset"], row["item"]): set(row["letters"]) for row in analysis["scores"]}
    for row in pairs:
        apart = not letters[row["dataset"], row["item_a"]] & letters[row["dataset"], row["item_b"]]
        assert apart == (row["p_holm_together"] < 0.05)


def test_levels_are_drawn_from_the_fit_that_tells_them_apart() -> None:
    items = {f"{depth}_{fusion}": depth for depth in "xyz" for fusion in "fg"}
    scores = {item: {"x": 0.0, "y": 0.5, "z": 1.0}[depth] for item, depth in items.items()}
    factors = {"depth": items, "fusion": {item: item[2] for item in items}}
    analysis = analyse(votes_from_rows(votes_by(scores, 8)), AnalysisSettings(factors=factors))
    effects = [row for row in analysis["effects"] if row["factor"] == "depth"]
    values = levels_chart(analysis, "depth").layer[1].data.values
    assert [value["score"] for value in values] == [row["effect"] for row in effects if row["dataset"] == "ball"]
    assert [row["effect"] for row in figure_rows("levels_depth", analysis)] == [row["effect"] for row in effects]
    assert [row["item"] for row in figure_rows("levels_depth", analysis)] == [row["level"] for row in effects]


def test_triads_stand_beside_random_votes_with_the_same_ties() -> None:
    analysis = analyse(votes_from_rows(votes_by(dict.fromkeys("abcdef", 0.0), 8, ties=0.5)))
    for row in analysis["triads_pooled"]:
        assert row["strict_by_chance"] < row["circular_by_chance"] == 5
    values = triads_chart(analysis).layer[1].encoding.x.shorthand
    assert values == "strict_by_chance:Q"


def test_lines_of_a_name_hold_all_of_it_and_are_no_wider_than_asked() -> None:
    for name in (*LONG[:1], "a" * 90, "one_two-three/four", "表面再構成方法" * 6):
        lines = wrapped(name, 150)
        assert "".join(lines).replace(" ", "") == name.replace(" ", "")
        assert all(text_width(line) <= 150 for line in lines)


def test_groups_differ_in_colour_and_shape_in_the_legend_too(few: dict[str, Any]) -> None:
    svg = chart_svg(groups_chart(few, "age"))
    legend = svg[svg.index("role-legend") :]
    assert PALETTE[0] in legend
    assert PALETTE[1] in legend
    assert len(set(re.findall(r'class="mark-symbol role-legend-symbol".*?<path[^>]*d="([^"]*)"', legend))) > 1


def test_an_order_effect_prints_one_number_in_a_cell(few: dict[str, Any]) -> None:
    for chart in (preference_chart(few), residual_chart(few)):
        values = chart.data.values
        assert len({(value["item"], value["other"]) for value in values}) == len(values) == 6
    total = sum(float(value["label"]) for value in preference_chart(few).data.values)
    assert total == few["votes"]["analysed"] - few["votes"]["ties"]


def test_datasets_stand_in_the_order_that_the_caption_states(few: dict[str, Any]) -> None:
    assert natural_order(["box 10", "Box 2", "ball", "box 1"]) == ["ball", "box 1", "Box 2", "box 10"]
    assert few["votes"]["datasets"] == ["box 2", "box 10"]
    captions = {name: caption for name, caption, _ in named_charts(few)}
    assert captions["scores"].endswith("Datasets in alphabetical order.")
    svg = chart_svg(scores_chart(few))
    assert svg.index(">box 2<") < svg.index(">box 10<") < svg.index(">all votes together<")


def test_a_single_dataset_is_drawn_once() -> None:
    analysis = analyse(votes_from_rows([vote | {"dataset": "box"} for vote in votes_by(CLEAR, 2)]))
    drawn = texts(chart_svg(scores_chart(analysis)))
    assert "box" in drawn
    assert "allvotestogether" not in drawn


def test_a_caption_speaks_of_intervals_only_where_there_are_any() -> None:
    alone = analyse(votes_from_rows(votes_by(dict.fromkeys("abc", 0.0), 1, ties=0.6)))
    captions = {name: caption for name, caption, _ in named_charts(alone)}
    assert captions["scores"].startswith("Scores of all conditions without intervals")


def test_letters_that_no_font_has_are_found() -> None:
    assert letters_without_font(["plain", "naïve", "zero\u200dwidth"]) == ""
    assert letters_without_font(["x\U000f0001", "\U000f0001"]) == "\U000f0001"  # for private use: in no font


@pytest.mark.parametrize(
    ("table", "column"),
    [("scores", "item"), ("groups", "group"), ("comparison_items", "condition"), ("raters", "participant")],
)
def test_whatever_a_figure_names_is_looked_up_in_fonts(table: str, column: str) -> None:
    assert list(font_warnings({"votes": None, table: [{column: "plain"}]})) == []
    (told,) = font_warnings({"votes": None, table: [{column: "plain \U000f0001"}]})
    assert "no font of this machine has the letters \U000f0001" in told


def test_the_code_of_every_figure_draws_it(
    few: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_json(tmp_path / "analysis.json", few)
    monkeypatch.chdir(tmp_path)
    for name in ("scores", "group_age", "preferences", "triads"):
        code = figure_code(name, few)
        exec(code["Python"].replace("save(", "to_dict() and str("), {})
        assert "ggplot" in code["R"]
    assert all(figure.code for figure in drawn_figures(few) if figure.name != "residuals")


def test_the_numbers_of_a_figure_are_those_that_it_draws(few: dict[str, Any]) -> None:
    assert figure_rows("triads", few) == few["triads_pooled"]
    assert {row["dataset"] for row in figure_rows("scores", few)} == {"box 2", "box 10", "all"}
    for name in ("preferences", "residuals", "group_age"):
        assert {row["dataset"] for row in figure_rows(name, few)} == {"all"}
    assert all(figure_rows(figure.name, few) for figure in drawn_figures(few))


@pytest.mark.slow
def test_names_that_differ_in_signs_alone_have_figures_of_their_own() -> None:
    votes = votes_by(CLEAR, 6)
    items = sorted({vote[side] for vote in votes for side in ("item_a", "item_b")})
    ages = [{f"p{number}": str(number % n) for number in range(6)} for n in (2, 3)]
    halves = {item: str(place // 2) for place, item in enumerate(items)}
    factors = {"a-b": halves, "a b": {item: str(place % 2) for place, item in enumerate(items)}}
    groups = {"Age?": ages[0], "age!": ages[1]}
    analysis = analyse(votes_from_rows(votes), AnalysisSettings(groups=groups, factors=factors))
    names = [name for name, _, _ in named_charts(analysis)]
    assert len({name.casefold() for name in names}) == len(names)
    codes = [figure_code(name, analysis).get("R", "") for name in names]
    assert all(sum(f'"{name}"' in code for code in codes) for name in (*groups, *factors))


def test_many_names_look_different_and_none_is_cut_in_the_legend() -> None:
    looks = list(zip(colours_of(40), shapes_of(40), strict=True))
    assert len(set(looks)) == 40
    long = ["PatchMatch stereo with slanted support windows", "id"]
    legends = [colour_by("x", "x", names, FULL).to_dict()["legend"] for names in (long, ["id", "dr", "pm"])]
    n_columns = [legend["columns"] for legend in legends]
    assert n_columns[0] * (text_width(long[0]) + 20) < FULL
    assert n_columns[1] >= 3


def test_a_long_title_fits_in_its_figure_also_in_wide_fonts() -> None:
    bar = {"mark": "bar", "data": {"values": [{"x": 1}]}, "encoding": {"x": {"field": "x", "type": "quantitative"}}}
    long = "Preferred over the others by participants of the second group"
    for title in (long, {"text": "Short", "subtitle": [long]}):
        svg = chart_svg({**bar, "title": title}, 5000)
        assert drawn_width(svg) >= text_width(long)
        assert f'viewBox="0 0 {drawn_width(svg):g} ' in svg
        with Image.open(BytesIO(svg_png(svg))) as picture:
            assert picture.getpixel((picture.width - 1, picture.height // 2)) == (255, 255, 255)
    assert drawn_width(chart_svg({**bar, "title": "Short"}, 5000)) < text_width(long)
