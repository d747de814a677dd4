"""`scene.json` of a models folder: which scene the models show, how they stand in it, and along which path they are
filmed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from ground.fields import Expected
from ground.file_models import READS, FilePart, WholeFile, faults_of
from recon.capture.format import CAPTURE_FILE, Capture, read_draft
from recon.geometry.rig import Y_FROM, Camera, Rig, Sensor, direction_of, look_at
from recon.models.folder import SafeName
from recon.models.read import MM, Placement
from recon.models.splats.read import holds_splats
from recon.models.trained_on import beside, world_from_trained
from recon.runtime.artefacts import file_digest
from recon.runtime.files import allowed, read_json
from recon.runtime.remote import is_there, place

SCENE_FILE = "scene.json"
SIMILAR = 1e-3  # relative; how far a transform may be from a rotation with one scale
SMALL_BASELINE_MM = 60.0  # of the sensor that stands for the camera of an orbit

Point = Annotated[list[float], Field(min_length=3, max_length=3), Expected("three numbers")]
Row = Annotated[list[float], Field(min_length=4, max_length=4), Expected("four numbers")]


class Orbit(FilePart):
    """A camera that goes once around the middle of the bounds; it stands at least so far away that they fit."""

    azimuth_deg: Annotated[float, Field(description="where it begins: 0 is on the z axis, 90 on the x axis")] = 0.0
    elevation_deg: Annotated[float, Field(ge=-80, le=80, description="how far above the horizon")] = 12.0
    distance_mm: Annotated[
        float | None, Field(gt=0, description="from the middle of the bounds; it grows until they fit the picture")
    ] = None


class ScenePath(FilePart):
    """Along which the models are filmed: exactly one of these."""

    sensors_of: Annotated[
        str | None, Field(description="a capture or a run, along whose sensors and in whose bounds the camera goes")
    ] = None
    orbit: Annotated[Orbit | None, Field(description="once around the middle of the bounds; `{}` for its defaults")] = (
        None
    )
    file: Annotated[
        str | None, Field(description="a path file, in the world of the models after `world_from_model`")
    ] = None


class Placed(FilePart):
    """How the models of an approach stand that stand in another way than the others of the folder."""

    units: Annotated[Literal["mm", "cm", "m"] | None, Field(description="of its files")] = None
    up: Annotated[Literal["x", "y", "z", "-x", "-y", "-z"] | None, Field(description="its axis that points up")] = None
    world_from_model: Annotated[
        list[Row] | None,
        Field(min_length=4, max_length=4, description="as that of the folder, which does not count for it"),
        Expected("four rows of four numbers"),
    ] = None
    trained_on: Annotated[
        str | None,
        Field(
            description="`dataparser_transforms.json` of nerfstudio, `transforms.json` or the folder of a COLMAP model "
            "that it was trained on, made from `capture export`; says unit, axes and place, so that nothing else may"
        ),
    ] = None
    antialiased: Annotated[
        bool, Field(description="whether its splats were trained with antialiasing (Mip-Splatting)")
    ] = False


class SceneContent(WholeFile):
    """The keys of `scene.json`; its paths are relative to its folder."""

    schema_version: Annotated[Literal[1], Field(description="of this file"), READS]
    dataset: Annotated[
        SafeName,
        Field(description="name of the scene; to be shown beside a run, the name in its `capture.json`"),
    ]
    fps: Annotated[float, Field(gt=0, le=1000, description="models a second", examples=[25])]
    units: Annotated[Literal["mm", "cm", "m"], Field(description="of all files, GLB included")]
    up: Annotated[Literal["x", "y", "z", "-x", "-y", "-z"], Field(description="the models' axis that points up")]
    path: Annotated[ScenePath, Field(description="along which the models are filmed; `render --path` replaces it")]
    world_from_model: Annotated[
        list[Row] | None,
        Field(
            min_length=4,
            max_length=4,
            description="a rotation with one scale, a translation in mm, and `0 0 0 1`; applied after `units` and `up`",
        ),
        Expected("four rows of four numbers"),
    ] = None
    bounds: Annotated[
        list[Point] | None,
        Field(
            min_length=2,
            max_length=2,
            description="lowest and highest corner of what is filmed, mm; empty: the box around all models of the "
            "scene. Refused with `sensors_of`, where those of the capture count",
        ),
        Expected("[[x, y, z], [x, y, z]]"),
    ] = None
    levels: Annotated[
        dict[str, dict[SafeName, SafeName]],
        Field(description="what an approach stands for in the analysis by factor"),
        Expected("{APPROACH: {FACTOR: LEVEL}}"),
    ] = Field(default_factory=dict)
    static: Annotated[
        list[str], Field(description="approaches of which only the first model is shown"), Expected("a list of names")
    ] = Field(default_factory=list)
    placements: Annotated[
        dict[str, Placed],
        Field(description="approaches that stand in another way than the others, such as splats"),
        Expected("{APPROACH: {KEY: VALUE}}"),
    ] = Field(default_factory=dict)
    splat_mm: Annotated[
        float | None,
        Field(gt=0, description="radius of the discs that point clouds are drawn by, mm; needed for clouds"),
    ] = None
    vertex_colours: Annotated[
        Literal["linear", "srgb"] | None,
        Field(
            description="what the colours of vertices in GLB and glTF files are: linear light by the standard; trimesh "
            "and Open3D write sRGB; empty: linear, with a warning where one of these wrote the file"
        ),
    ] = None


class PathSource(NamedTuple):
    """Whose camera path films the models: sensors with the bounds they look at, an orbit, or the file of a path."""

    capture: Capture | None = None
    orbit: Orbit | None = None
    file: Path | None = None


@dataclass(frozen=True, eq=False)
class SceneFile:
    """What a `scene.json` says.

    Parameters
    ----------
    file : its path
    content : as it stands there
    dataset, fps : name of the scene, and frames a second of the models
    placement : how a model comes into the world whose approach has none of its own
    placements : those of approaches that have
    path : where the cameras come from
    bounds : float64 (2, 3), mm, of what is filmed; None where they follow from the models
    levels : factor -> level of approaches that have some
    static : approaches that show one model throughout
    """

    file: Path
    content: dict[str, Any]
    dataset: str
    fps: float
    placement: Placement
    path: PathSource
    bounds: NDArray[np.float64] | None
    levels: dict[str, dict[str, str]]
    static: tuple[str, ...]
    placements: Mapping[str, Placement] = field(default_factory=dict)

    def placement_of(self, approach: str, model: Path, problems: list[str]) -> Placement:
        """Return how the models of an approach come into the world, and add to `problems` why it cannot be told.

        Splats that lie beside the file of their training stand where it says.

        Parameters
        ----------
        approach : its name
        model : its first file
        problems : sentences
        """
        if approach in self.placements:
            return self.placements[approach]
        if (file := beside(model)) is not None and holds_splats(model):
            return _trained(self.placement, file, self.path.capture, problems)
        return self.placement

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return file_digest(self.file)


def read_scene_file(folder: Path) -> tuple[SceneFile | None, list[str]]:
    """Read the `scene.json` of a models folder; returns it if nothing is wrong, and a sentence for each fault."""
    file = folder / SCENE_FILE
    try:
        raw = read_json(file)
    except ValueError as error:
        return None, [str(error)]
    try:
        content = SceneContent.model_validate(raw)
    except ValidationError as error:
        return None, [f"{file}: {fault}" for fault in faults_of(error, SceneContent)]
    problems: list[str] = []
    path = _path_source(folder, content.path, problems)
    matrix = _world_from_model(content, problems)
    bounds = None if content.bounds is None else np.array(content.bounds, dtype=np.float64)
    if bounds is not None and not (bounds[0] < bounds[1]).all():
        problems.append(f"bounds: the lowest corner {content.bounds} is not below the highest")
    if bounds is not None and path is not None and path.capture is not None:
        problems.append("bounds are given, but those of the capture in path.sensors_of count; leave one of them out")
    if problems or path is None:
        return None, [f"{file}: {problem}" for problem in problems]
    if path.capture is not None:
        bounds = path.capture.bounds
    placement = Placement(
        content.units,
        tuple(map(tuple, matrix.tolist())),
        content.splat_mm,
        vertex_colours=content.vertex_colours,
    )
    placements = {
        approach: _placed(placed, content, folder, path.capture, problems)
        for approach, placed in content.placements.items()
    }
    if problems:
        return None, [f"{file}: {problem}" for problem in problems]
    return (
        SceneFile(
            file,
            raw,
            content.dataset,
            content.fps,
            placement,
            path,
            bounds,
            content.levels,
            tuple(content.static),
            placements,
        ),
        [],
    )


def orbit_rig(orbit: Orbit, bounds: NDArray[np.float64]) -> Rig:
    """Return a rig of one sensor where an orbit begins, looking at the middle of the bounds.

    Parameters
    ----------
    orbit : from where
    bounds : float64 (2, 3), mm
    """
    centre, radius = bounds.mean(axis=0), float(np.linalg.norm(bounds[1] - bounds[0])) / 2
    direction = direction_of(np.deg2rad(orbit.azimuth_deg), np.deg2rad(orbit.elevation_deg))
    place_ = centre + direction * (orbit.distance_mm or radius)
    aside = np.cross(direction, [0.0, 1.0, 0.0])
    aside *= SMALL_BASELINE_MM / 2 / np.linalg.norm(aside)
    K = np.array([[1000.0, 0, 319.5], [0, 1000.0, 239.5], [0, 0, 1]])
    left, right = (Camera(K, (640, 480), look_at(place_ + side, centre + side)) for side in (aside, -aside))
    return Rig((Sensor("orbit", left, right),))


def _path_source(folder: Path, path: ScenePath, problems: list[str]) -> PathSource | None:
    given = [name for name in ("sensors_of", "orbit", "file") if getattr(path, name) is not None]
    if len(given) != 1:
        problems.append(
            f"path has {' and '.join(given) or 'nothing'}, expected one of sensors_of (a capture or run), orbit, file"
        )
        return None
    if path.orbit is not None:
        return PathSource(orbit=path.orbit)
    try:
        named = _beside(folder, path.sensors_of or path.file or "")
    except ValueError as error:
        problems.append(f"path.{given[0]}: {error}")
        return None
    if path.file is not None:
        if not is_there(named):
            problems.append(f"path.file names {path.file!r}, but there is no file at {named}")
            return None
        return PathSource(file=named)
    if not is_there(named / CAPTURE_FILE):
        problems.append(
            f"path.sensors_of names {path.sensors_of!r}, but {named} is no capture and no run: it has no {CAPTURE_FILE}"
        )
        return None
    draft = read_draft(named)
    if draft.capture is None:
        problems.append(f"path.sensors_of: {draft.problems[0]}")
        return None
    return PathSource(capture=draft.capture)


def _placed(
    placed: Placed, content: SceneContent, folder: Path, capture: Capture | None, problems: list[str]
) -> Placement:
    """Return the placement of an approach that has one of its own."""
    usual = Placement(content.units, (), content.splat_mm, placed.antialiased, content.vertex_colours)
    if placed.trained_on is None:
        stated = content.model_copy(
            update={
                "units": placed.units or content.units,
                "up": placed.up or content.up,
                "world_from_model": placed.world_from_model,
            }
        )
        matrix = _world_from_model(stated, problems)
        return replace(usual, unit=stated.units, world_from_model=tuple(map(tuple, matrix.tolist())))
    if placed.units or placed.up or placed.world_from_model:
        problems.append("placements: trained_on says where a model stands; leave out units, up and world_from_model")
    try:
        return _trained(usual, _beside(folder, placed.trained_on), capture, problems)
    except ValueError as error:
        problems.append(f"placements.trained_on: {error}")
        return usual


def _trained(usual: Placement, file: Path, capture: Capture | None, problems: list[str]) -> Placement:
    try:
        matrix = world_from_trained(file, capture)
    except (ValueError, OSError) as error:
        problems.append(str(error))
        return usual
    return replace(usual, unit="m", world_from_model=tuple(map(tuple, matrix.tolist())))


def _beside(folder: Path, address: str) -> Path:
    """Find what `scene.json` names: a URL, or a path from its folder."""
    is_url = "://" in address
    allowed(Path("/", address) if is_url else folder / address)  # before anything is asked of a URL's host
    return place(address) if is_url else (folder / address).resolve()


def _world_from_model(content: SceneContent, problems: list[str]) -> NDArray[np.float64]:
    """Return float64 (4, 4): first the unit and the axes, then the transform of the file."""
    matrix = np.eye(4)
    matrix[:3, :3] = Y_FROM[content.up] * MM[content.units]
    if content.world_from_model is None:
        return matrix
    given = np.array(content.world_from_model, dtype=np.float64)
    linear = given[:3, :3]
    scale = np.cbrt(abs(np.linalg.det(linear)))
    unlike = scale <= 0 or np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > SIMILAR
    if unlike or np.linalg.det(linear) < 0 or not np.array_equal(given[3], (0, 0, 0, 1)):
        problems.append(
            f"world_from_model is {content.world_from_model}, expected four rows: a rotation with one scale, not a "
            "mirror, a translation in mm, and 0 0 0 1"
        )
    return np.asarray(given @ matrix)
