"""Splats of every form are read as the programs that wrote them meant, and what is wrong with them is named."""

from __future__ import annotations

import gzip
import io
import json
import struct
import tracemalloc
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from recon.geometry.splats import Splats
from recon.models import read_splats
from recon.models.splats.ksplat import HEADER
from recon.models.splats.raw import MOST_SPLATS
from recon.models.splats.read import SPLAT_READERS, holds_splats, read_with_warnings

FILES = Path(__file__).parent / "files"
PLAIN = FILES / "few.ply"
SPZ_TURN = np.diag([1.0, -1, -1, 1])
# Besides the form's name: how far centres (of 20 across), shapes (of each), opacities and harmonics may be off.
FORMS = {
    "few.compressed.ply": (0.01, 0.005, 0.003, 0.02),
    "few.sog": (0.001, 0.03, 0.005, 0.4),
    "few_v3.spz": (0.0005, 0.15, 0.005, 0.08),
    "few_v4.spz": (0.0005, 0.15, 0.005, 0.08),
    "few_level0.ksplat": (0.0, 1e-6, 0.005, 0.02),
    "few_level1.ksplat": (0.0001, 0.003, 0.005, 0.02),
    "few_level2.ksplat": (0.0001, 0.003, 0.005, 0.02),
}


def shapes(splats: Splats) -> NDArray[np.float64]:
    """Return the covariance of each splat, (N, 3, 3)."""
    axes = Rotation.from_quat(splats.rotations[:, [1, 2, 3, 0]]).as_matrix() * splats.scales[:, None]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


@pytest.mark.parametrize("name", FORMS)
def test_a_form_holds_what_the_plain_file_holds_as_far_as_it_can(name: str) -> None:
    expected, read = read_splats(PLAIN), read_splats(FILES / name)
    assert (read.model_from_world == np.eye(3)).all()
    if name.endswith(".spz"):
        # The form turns the harmonics as well; a turn by half a revolution changes only their signs.
        signs = np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1])
        read = read.moved(SPZ_TURN)
        turned = read.harmonics * signs[:, None]
    else:
        turned = read.harmonics
    distances, places = cKDTree(read.centres).query(expected.centres)
    centre, shape, opacity, harmonic = FORMS[name]
    assert len(read) == len(set(places.tolist())) == len(expected)
    assert distances.max() <= centre
    difference = np.abs(shapes(read)[places] - shapes(expected)).max(axis=(1, 2))
    assert (difference / np.abs(shapes(expected)).max(axis=(1, 2))).max() <= shape
    assert np.abs(read.opacities[places] - expected.opacities).max() <= opacity
    n = read.harmonics.shape[1]
    assert n == (9 if "ksplat" in name else 16)
    assert np.abs(turned[places] - expected.harmonics[:, :n]).max() <= harmonic


@pytest.mark.parametrize("name", ["minimal.splat", "minimal.ksplat", "minimal-v2.spz", "minimal-v3.spz"])
def test_four_splats_of_other_programs_have_their_places(real_data: Path, name: str) -> None:
    read = read_splats(real_data / "splats" / name)
    z = 1 if "v3" in name else -1
    assert read.centres.tolist() == [[-1, 0, z], [0, 0, z], [-1, 0, 0], [0, 0, 0]]
    assert np.allclose(read.scales, 0.1, rtol=0.02)
    assert np.allclose(read.opacities, 0.9, atol=0.003)
    assert read.harmonics.shape == (4, 1, 3)


def ply(columns: dict[str, object], n: int) -> bytes:
    """Write a PLY of splats with the numbers that are given; the others are those of one round splat."""
    usual: dict[str, object] = {"x": 0, "y": 0, "z": 0, "f_dc_0": 1, "f_dc_1": 0, "f_dc_2": 0, "opacity": 2}
    usual |= {f"scale_{axis}": 0 for axis in range(3)} | {"rot_0": 1, "rot_1": 0, "rot_2": 0, "rot_3": 0}
    every = {name: value for name, value in (usual | columns).items() if value is not None}
    table = np.stack([np.broadcast_to(np.asarray(value, "<f4"), n) for value in every.values()], axis=1)
    header = "".join(f"property float {name}\n" for name in every)
    start = f"ply\nformat binary_little_endian 1.0\nelement vertex {n}\n{header}end_header\n"
    return start.encode() + table.astype("<f4").tobytes()


def written(folder: Path, content: bytes, name: str = "a.ply") -> Path:
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_harmonics_stand_channel_by_channel_in_the_trainers_file(tmp_path: Path, degree: int) -> None:
    n_rest = (degree + 1) ** 2 - 1
    rest = {f"f_rest_{channel * n_rest + k}": 10 * k + channel for channel in range(3) for k in range(n_rest)}
    read = read_splats(written(tmp_path, ply(rest, 2)))
    assert read.harmonics[1, 0].tolist() == [1, 0, 0]
    assert read.harmonics[1, 1:].tolist() == [[10 * k, 10 * k + 1, 10 * k + 2] for k in range(n_rest)]
    assert read.scales[0].tolist() == [1, 1, 1]
    assert read.opacities[0] == pytest.approx(1 / (1 + np.exp(-2)))


def test_splats_that_are_flat_have_two_scales(tmp_path: Path) -> None:
    assert read_splats(written(tmp_path, ply({"scale_2": None}, 1))).scales.tolist() == [[1, 1, 0]]


def test_what_cannot_be_drawn_is_left_out_and_said(tmp_path: Path) -> None:
    columns: dict[str, object] = {"x": [0, np.nan, 2, 3], "scale_1": [0, 0, 200, 0], "rot_0": [0, 1, 1, 2]}
    read, warnings = read_with_warnings(written(tmp_path, ply(columns, 4)))
    assert read.centres[:, 0].tolist() == [0, 3]
    assert read.rotations.tolist() == [[1, 0, 0, 0], [1, 0, 0, 0]]
    assert warnings == (
        "has 1 splats with the quaternion 0, which are not turned",
        "has 2 of 4 splats with numbers that are not finite, which are left out",
    )


def test_a_file_without_one_splat_that_can_be_drawn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.ply: none of its 3 splats has finite numbers"):
        read_splats(written(tmp_path, ply({"opacity": np.nan}, 3)))
    with pytest.raises(ValueError, match="holds no splats"):
        read_splats(written(tmp_path, b"", "a.splat"))


def test_a_missing_property_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="have no property opacity"):
        read_splats(written(tmp_path, ply({"opacity": None}, 3)))


@pytest.mark.parametrize("name", ["few.ply", *FORMS])
@pytest.mark.parametrize("share", [0.01, 0.4, 0.97])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, name: str, share: float) -> None:
    content = (FILES / name).read_bytes()
    suffix = "".join(Path(name).suffixes)
    cut = written(tmp_path, content[: int(share * len(content))], f"cut{suffix}")
    with pytest.raises(ValueError, match=r"cut\."):
        read_splats(cut)


def zipped_by_hand(tmp_path: Path) -> bytes:
    """A SOG whose files are packed, as programs for archives do; those that write SOG store them as they are."""
    path = tmp_path / "by_hand.sog"
    with zipfile.ZipFile(FILES / "few.sog") as known, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name in known.namelist():
            packed.writestr(name, known.read(name))
    return path.read_bytes()


@pytest.mark.parametrize("name", [*FORMS, "by_hand.sog"])
def test_damaged_files_are_read_or_refused_in_words(tmp_path: Path, name: str) -> None:
    content = np.frombuffer(zipped_by_hand(tmp_path) if name not in FORMS else (FILES / name).read_bytes(), np.uint8)
    rng = np.random.default_rng(1)
    for number in range(30):
        damaged = content.copy()
        damaged[rng.integers(0, min(len(content), 600 if number % 2 else len(content)), 4)] = rng.integers(0, 256, 4)
        with suppress(ValueError):  # anything else would be a fault of ours
            read_splats(written(tmp_path, damaged.tobytes(), name))


@pytest.mark.parametrize("numbers", [{32: 1_600_000_000}, {4: 4_000_000_000, 8: 4_000_000_000}])  # full; room, each
def test_buckets_that_no_machine_could_hold_take_no_memory(tmp_path: Path, numbers: dict[int, int]) -> None:
    content = bytearray((FILES / "few_level1.ksplat").read_bytes())
    for place, number in numbers.items():
        struct.pack_into("<I", content, HEADER + place, number)
    tracemalloc.start()
    with suppress(ValueError):
        read_splats(written(tmp_path, bytes(content), "few.ksplat"))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10_000_000


def test_a_count_that_no_machine_could_hold_is_refused_before_memory_is_asked_for(tmp_path: Path) -> None:
    spz = gzip.compress(struct.pack("<4sIIBBBx", b"NGSP", 3, 4_000_000_000, 3, 12, 0))
    with pytest.raises(ValueError, match=r"it has 4000000000 splats, expected 8000000 at most"):
        read_splats(written(tmp_path, spz, "a.spz"))
    ksplat = bytearray((FILES / "few_level0.ksplat").read_bytes())
    ksplat[16:20] = struct.pack("<I", MOST_SPLATS + 1)
    with pytest.raises(ValueError, match="expected 8000000 at most"):
        read_splats(written(tmp_path, bytes(ksplat), "a.ksplat"))
    with pytest.raises(ValueError, match="promises 9999999 rows, but the file has only"):
        read_splats(written(tmp_path, ply({}, 2).replace(b"vertex 2", b"vertex 9999999")))


def test_spz_whose_numbers_end_where_its_model_goes_on_is_told(tmp_path: Path) -> None:
    body = bytearray(gzip.decompress((FILES / "few_v3.spz").read_bytes()))
    assert read_with_warnings(FILES / "few_v3.spz")[1] == ()
    body[16:19] = b"\xff\xff\x7f"  # the first coordinate
    (clause,) = read_with_warnings(written(tmp_path, gzip.compress(bytes(body)), "a.spz"))[1]
    assert clause.startswith("reaches 2048 of its unit, where its numbers end: what lay farther out is elsewhere")


def test_spz_says_whether_the_method_was_trained_with_antialiasing(tmp_path: Path) -> None:
    body = bytearray(gzip.decompress((FILES / "few_v3.spz").read_bytes()))
    assert not read_splats(FILES / "few_v3.spz").antialiased
    body[14] |= 1
    assert read_splats(written(tmp_path, gzip.compress(bytes(body)), "a.spz")).antialiased


def test_sog_of_the_first_version_has_bounds_instead_of_codebooks(tmp_path: Path) -> None:
    """A bundle of version 2 whose codebooks are evenly spaced is the same as one of version 1."""
    with zipfile.ZipFile(FILES / "few.sog") as bundle:
        parts = {name: bundle.read(name) for name in bundle.namelist()}
    even = np.linspace(-2, 3, 256).tolist()

    def read(meta: dict[str, object]) -> Splats:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w") as bundle:
            for name, part in parts.items():
                bundle.writestr(name, json.dumps(meta) if name == "meta.json" else part)
        return read_splats(written(tmp_path, content.getvalue(), "a.sog"))

    second = json.loads(parts["meta.json"])
    for key in ("scales", "sh0", "shN"):
        second[key]["codebook"] = even
    first = {key: dict(value) for key, value in second.items() if isinstance(value, dict)}
    first["means"]["shape"] = [second["count"], 3]
    first["scales"] = {"files": second["scales"]["files"], "mins": [-2] * 3, "maxs": [3] * 3}
    first["sh0"] = {"files": second["sh0"]["files"], "mins": [-2] * 3 + [-5], "maxs": [3] * 3 + [5]}
    first["shN"] = {"files": second["shN"]["files"], "mins": -2, "maxs": 3}
    old, new = read(first), read(second)
    assert np.allclose(old.centres, new.centres)
    assert np.allclose(old.scales, new.scales, rtol=1e-5)
    assert np.allclose(old.harmonics, new.harmonics, atol=1e-5)
    assert np.allclose(old.opacities, 1 / (1 + np.exp(5 - 10 * new.opacities)), atol=1e-5)


def test_only_files_of_splats_are_taken_for_them(tmp_path: Path) -> None:
    coordinates = b"".join(b"property float %c\n" % axis for axis in b"xyz")
    cloud = b"ply\nformat ascii 1.0\nelement vertex 1\n" + coordinates + b"end_header\n0 0 0\n"
    assert not holds_splats(written(tmp_path, cloud))
    assert not holds_splats(tmp_path / "absent.ply")
    assert all(holds_splats(FILES / name) for name in FORMS)
    with pytest.raises(ValueError, match=r"is no file of splats, expected \.ply, \.spz"):
        read_splats(written(tmp_path, b"", "a.obj"))
    assert set(SPLAT_READERS) == {".ply", ".spz", ".splat", ".ksplat", ".sog"}
