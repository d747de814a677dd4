"""Measures of others that are installed as Python packages, and the contract that they keep.

A measure is a function of two `PointSet`, the reference and the distorted cloud, that returns a list of `Value`. A
package registers it in the entry-point group ``reconstudy.measures``; docs/measures.md shows one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import isnan

import numpy as np

from recon.plugins import MEASURES_GROUP, Plugin, PluginError, registered
from recon.validation.cloud_quality.compared import SYMMETRIC, TO_DISTORTED, TO_REFERENCE, Pair, Value
from recon.validation.cloud_quality.measures import MEASURES, Measure, Scale
from recon.validation.cloud_quality.points import PointSet
from recon.validation.measures import BETTER
from recon.validation.sampling import fibonacci_sphere

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


def check_measure(measure: PluginMeasure) -> None:
    """Raise an AssertionError, with the reason, if a measure does not keep the contract.

    It must return a list of `Value` for clouds with and without colours and normals, or raise a ValueError that says
    what is missing; the same for the same clouds; leave the clouds as they are; and not rate a noisy cloud better than
    the reference itself.
    """
    whole = _ball(noise=0.0)
    bare = PointSet("bare", whole.points)
    noisy = _ball(noise=0.05)
    before = noisy.points.copy()
    best, worse = _values(measure, whole, whole), _values(measure, whole, noisy)
    assert best, "it returned no value for two equal clouds with colours and normals"
    assert _values(measure, whole, noisy) == worse, "it gave other values for the same clouds"
    assert np.array_equal(noisy.points, before), "it changed the points that it was given"
    by_name = {(value.measure, value.direction): value for value in best}
    for value in worse:
        perfect = by_name.get((value.measure, value.direction))
        assert perfect is not None, f"it gave {value.measure} for a noisy cloud, but not for two equal ones"
        sign = 1 if value.better == "higher" else -1
        assert sign * value.value <= sign * perfect.value, (
            f"{value.measure} is {value.value:g} for a noisy cloud and {perfect.value:g} for the reference itself, "
            f"where {value.better} is better"
        )
    _values(measure, bare, bare)


def _values(measure: PluginMeasure, reference: PointSet, distorted: PointSet) -> list[Value]:
    try:
        returned = measure(reference, distorted)
    except ValueError:
        return []
    except Exception as error:
        raise AssertionError(f"it raised {error!r}, expected a ValueError that says what is missing") from error
    try:
        return checked_values(returned)
    except (TypeError, ValueError) as error:
        raise AssertionError(str(error)) from error


def _ball(noise: float) -> PointSet:
    directions = fibonacci_sphere(500)
    points = directions + np.random.default_rng(1).normal(0, noise, directions.shape) if noise else directions
    colours = np.rint(127 * (1 + directions)).astype(np.uint8)
    return PointSet("ball", points.astype(np.float32), directions.astype(np.float32), colours)


def _measure_by_plugin(plugin: Plugin, pair: Pair, _scale: Scale) -> list[Value]:
    measure = plugin.load()
    if not callable(measure):
        raise PluginError(f"{plugin}: {plugin.target} is no function")
    try:
        return checked_values(measure(pair.reference.cloud, pair.distorted.cloud))
    except Exception as error:  # a package of others may raise anything
        raise PluginError(f"{plugin}: {error}") from error
