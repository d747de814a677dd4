"""Measures of others that are installed as Python packages, and what they may return.

A measure is a function of two `PointSet`, the reference and the distorted cloud, that returns a list of `Value`. A
package registers it in the entry-point group ``reconstudy.measures``; docs/measures.md shows one, and
`recon.contract.check_measure` tests one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import isnan

from recon.methods.plugins import MEASURES_GROUP, Plugin, registered
from recon.validation.cloud_quality.compared import SYMMETRIC, TO_DISTORTED, TO_REFERENCE, Pair, Value
from recon.validation.cloud_quality.measures import MEASURES, Measure, Scale
from recon.validation.cloud_quality.points import PointSet
from recon.validation.measures import BETTER

PluginMeasure = Callable[[PointSet, PointSet], Sequence[Value]]

DIRECTIONS = ("", SYMMETRIC, TO_DISTORTED, TO_REFERENCE)
LONGEST_UNIT = 40  # letters, that a study takes


def plugin_measures() -> dict[str, tuple[Measure, str]]:
    """Find the measures of installed packages by name, each with its source in words, without importing them."""
    plugins = registered(MEASURES_GROUP, MEASURES)
    return {name: (partial(_measure_by_plugin, plugin), str(plugin)) for name, plugin in plugins.items()}


def checked_values(values: object) -> list[Value]:
    """Return what a measure returned if it is a list of usable values.

    Raises
    ------
    TypeError
        If it is not a list of `Value`.
    ValueError
        If a value is not a number, or a word is not one of those expected.
    """
    if not isinstance(values, Sequence) or not all(isinstance(value, Value) for value in values):
        raise TypeError(f"it returned {values!r:.100}, expected a list of Value")
    seen = set()
    for value in values:
        if not isinstance(value.value, (int, float)) or isnan(value.value):
            raise ValueError(f"{value.measure} is {value.value!r}, expected a number; raise a ValueError where none is")
        if not value.measure or value.better not in BETTER.values() or value.direction not in DIRECTIONS:
            raise ValueError(
                f"{value} is not usable; expected a name, better {' or '.join(BETTER.values())}, and as direction one "
                f"of {', '.join(DIRECTIONS[1:])} or nothing"
            )
        if len(value.unit) > LONGEST_UNIT:
            raise ValueError(
                f"the unit of {value.measure} has {len(value.unit)} letters, expected {LONGEST_UNIT} at most"
            )
        if (value.measure, value.direction) in seen:
            raise ValueError(f"{value.measure} comes twice for the direction {value.direction!r}")
        seen.add((value.measure, value.direction))
    return list(values)


def _measure_by_plugin(plugin: Plugin, pair: Pair, _scale: Scale) -> list[Value]:
    measure = plugin.load()
    with plugin.running():
        return checked_values(measure(pair.reference.cloud, pair.distorted.cloud))
