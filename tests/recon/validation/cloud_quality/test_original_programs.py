"""The values that the original programs print for three pairs of clouds, which came with the rules that they follow."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from recon.render.encoding.quality import psnr_db
from recon.validation.cloud_quality.colour import colours
from recon.validation.cloud_quality.compared import SYMMETRIC, TO_DISTORTED, TO_REFERENCE, Pair, Prepared
from recon.validation.cloud_quality.geometry import d1, d2, intrinsic_peak
from recon.validation.cloud_quality.pointssim import QUANTITIES, pointssim
from recon.validation.cloud_quality.reading import read_point_set

PAIRS = ("torus_noise_low", "person_voxel_merged", "real_half_colour_noise")
SMALLEST_DOUBLE = 1e-300  # the program prints one where nothing is as far as that
WITH_TIES = 3e-2  # by which curvatures differ between libraries of linear algebra where eigenvalues tie
PART = {
    "pointssim_geometry": "geometry",
    "pointssim_normals": "normals_estimated",
    "pointssim_curvature": "curvature_estimated",
    "pointssim_colour": "colour",
    "pointssim_normals_from_files": "normals_from_files",
}
DIRECTION = {
    TO_DISTORTED: "reference_with_distorted_as_reference",
    TO_REFERENCE: "distorted_with_reference_as_reference",
    SYMMETRIC: "symmetric",
}


@cache
def case(folder: Path, name: str) -> tuple[Pair, dict[str, Any]]:
    expected = json.loads((folder / "expected.json").read_text())["pairs"][name]
    clouds = (Prepared(read_point_set(folder / expected["files"][role])) for role in ("reference", "distorted"))
    return Pair(*clouds), expected


@pytest.mark.parametrize("name", PAIRS)
def test_distances_and_colours_are_those_of_pc_error(real_data: Path, name: str) -> None:
    pair, expected = case(real_data / "metrics", name)
    program = expected["pc_error"]
    values = [*d1(pair, program["peak"], "m"), *d2(pair, program["peak"], "m"), *colours(pair)]
    printed = {
        (measure, direction): float(value)
        for direction in DIRECTION
        for measure, value in program[direction].items()
        if not 0 < float(value) < SMALLEST_DOUBLE
    }
    ours = {(value.measure, value.direction): value.value for value in values}
    assert {place: ours[place] for place in printed} == pytest.approx(printed, rel=1e-6)
    assert all(ours[place] == 0 for place in ours.keys() - printed.keys())


@pytest.mark.parametrize("name", PAIRS)
def test_the_peak_that_pc_error_finds_is_found(real_data: Path, name: str) -> None:
    pair, expected = case(real_data / "metrics", name)
    program = expected["pc_error"]
    peak = intrinsic_peak(pair.reference)
    assert peak == pytest.approx(program["peak_found_without_option"], rel=1e-6)
    assert peak is not None
    for measure in ("d1", "d2"):
        ratio = psnr_db(program["symmetric"][f"{measure}_mse"], 3 * peak**2)
        assert ratio == pytest.approx(program[f"symmetric_{measure}_psnr_db_with_that_peak"], rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("name", PAIRS)
def test_similarities_are_those_of_the_scripts_of_pointssim(real_data: Path, name: str, quantity: str) -> None:
    pair, expected = case(real_data / "metrics", name)
    has_ties = quantity == "pointssim_curvature" and not expected["pointssim"]["curvature_reproducible_to_1e-4"]
    scripts = expected["pointssim"][PART[quantity]]
    ours = {DIRECTION[value.direction]: value.value for value in pointssim(quantity, pair)}
    theirs = {direction: scripts[direction]["VAR"]["Mean"] for direction in DIRECTION.values()}
    assert ours == pytest.approx(theirs, rel=WITH_TIES if has_ties else 1e-6)
