"""Find room for the names of points in a figure, or for numbers where the names have none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from app.analysis.drawing.charts_in_common import text_width

Row = Mapping[str, Any]

LABEL_SIZE, LETTER_HEIGHT = 10, 11.0  # pixels of a label's letters
AWAY = 7.0  # pixels between a point and its label
DISTANCES = (1.0, 2.6, 4.4)  # in units of AWAY; beyond the first, a line leads to the point


class Box(NamedTuple):
    """A rectangle in pixels."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box) -> bool:
        """Do the two overlap?"""
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )


class Place(NamedTuple):
    """Where a label may stand: the corner or side of its box that looks at the point, and how it is aligned."""

    right: int  # 1 right of the point, -1 left, 0 above or below
    down: int  # 1 below, -1 above
    distance: float  # pixels

    def box(self, x: float, y: float, width: float) -> Box:
        """Return the box of a label beside a point.

        Parameters
        ----------
        x, y : the point, in pixels
        width : of the label, in pixels
        """
        near = self.distance / 1.4 if self.right and self.down else self.distance
        left = x + self.right * near - width * (1 - self.right) / 2
        top = y + self.down * near - LETTER_HEIGHT * (1 - self.down) / 2
        return Box(left, top, left + width, top + LETTER_HEIGHT)


PLACES = [
    Place(right, down, AWAY * distance)
    for distance in DISTANCES
    for right, down in ((1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1))
]


class Frame(NamedTuple):
    """The figure's rectangle: what its axes span, and its size in pixels."""

    x_domain: Sequence[float]
    y_domain: Sequence[float]
    width: float
    height: float

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return where a value is drawn, from the left and from the top."""
        (left, right), (bottom, top) = self.x_domain, self.y_domain
        return (x - left) * self.width / (right - left), (top - y) * self.height / (top - bottom)

    def value(self, x: float, y: float) -> tuple[float, float]:
        """Return the value that is drawn at a pixel."""
        (left, right), (bottom, top) = self.x_domain, self.y_domain
        return left + x * (right - left) / self.width, top - y * (top - bottom) / self.height

    def holds(self, box: Box) -> bool:
        """Is a box inside?"""
        return box.left >= 0 and box.right <= self.width and box.top >= 0 and box.bottom <= self.height


def place_names(points: Sequence[Row], frame: Frame) -> tuple[list[dict[str, Any]], list[str]]:
    """Place the items' names beside their points, or the numbers of the items if there is no room for all names.

    Parameters
    ----------
    points : with `item`, `x`, `y`, and the interval's `low` and `high`
    frame : around them

    Returns
    -------
    labels : as from `place_labels`
    numbered : the items in the order of their numbers, the highest first; empty where the names are the labels
    """
    names = place_labels(points, [point["item"] for point in points], frame)
    if len(names) == len(points):
        return names, []
    heights: dict[str, list[float]] = {}
    for point in points:
        heights.setdefault(point["item"], []).append(point["y"])
    numbered = sorted(heights, key=lambda item: -sum(heights[item]) / len(heights[item]))
    number = {item: str(place) for place, item in enumerate(numbered, start=1)}
    return place_labels(points, [number[point["item"]] for point in points], frame), numbered


def place_labels(points: Sequence[Row], texts: Sequence[str], frame: Frame) -> list[dict[str, Any]]:
    """Find a place for each text, none over another or over a point; one without room anywhere is left out.

    Parameters
    ----------
    points, frame : as in `place_names`
    texts : one for each point

    Returns
    -------
    label : its `text` and middle, `label_x` and `label_y`, and where it `is_far` from its point, both ends of the line
        that leads there
    """
    centres = [frame.pixel(point["x"], point["y"]) for point in points]
    half = AWAY / 2
    taken = [Box(x - half, y - half, x + half, y + half) for x, y in centres]
    intervals = [
        Box(x - 1, frame.pixel(0, point["high"])[1], x + 1, frame.pixel(0, point["low"])[1])
        for point, (x, _) in zip(points, centres, strict=True)
    ]
    labels = []
    for point, text, (x, y) in zip(points, texts, centres, strict=True):
        width = text_width(text, LABEL_SIZE)
        boxes = ((place.box(x, y, width), place.distance > AWAY) for place in PLACES)
        free = [(box, is_far) for box, is_far in boxes if frame.holds(box) and not _meets_any(box, taken)]
        clear = [(box, is_far) for box, is_far in free if not _meets_any(box, intervals)]
        for box, is_far in (clear or free)[:1]:  # over an interval only where there is no other room
            taken.append(box)
            label_x, label_y = frame.value((box.left + box.right) / 2, (box.top + box.bottom) / 2)
            near_x, near_y = frame.value(min(max(x, box.left), box.right), min(max(y, box.top), box.bottom))
            middle = {"text": text, "label_x": label_x, "label_y": label_y, "is_far": is_far}
            labels.append(middle | {"x": point["x"], "y": point["y"], "near_x": near_x, "near_y": near_y})
    return labels


def _meets_any(box: Box, others: Iterable[Box]) -> bool:
    return any(box.meets(other) for other in others)
