"""The methods that a run can use, by name: ours, those of installed packages, and those of a methods file.

docs/depth.md shows a methods file and a package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.recording import GIVEN
from recon.depth import CPU, DEFAULTS, MATCHERS, Parameters, Past, StereoPair, matched
from recon.depth.pair import check_range, within_pair
from recon.depth.patchmatch import PmParameters
from recon.depth.program import DepthProgram, match_by_program
from recon.depth.temporal import TemporalParameters
from recon.fusion import FUSIONS, DepthView, asks_for_views, fused
from recon.fusion.program import FusionProgram, fuse_by_program
from recon.fusion.views import check_place, with_unit_normals
from recon.geometry.mesh import Cloud, Mesh
from recon.methods.methods_file import Table, read_tables
from recon.methods.plugins import DEPTH_GROUP, FUSION_GROUP, Plugin, PluginError, default_parameters, registered
from recon.pipeline.keys import digest_once
from recon.runtime.programs import Program
from recon.surface import NoSurfaceError, SurfaceParameters, with_voxel

NO_SEED = "none"  # of PM in a methods file: planes at random, as Bleyer et al. 2011 start


@dataclass(frozen=True)
class OurDepth:
    """A name in `MATCHERS`, and the parameters that it is run with."""

    method: str
    parameters: Parameters


@dataclass(frozen=True)
class OurFusion:
    """A name in `FUSIONS`, and what it changes of its parameters in a run."""

    method: str
    changes: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Installed:
    """A plug-in, imported when it is used, and the table that sets its parameters; None leaves their defaults."""

    plugin: Plugin
    table: Table | None = None

    def load(self) -> tuple[Callable[..., Any], Any]:
        """Return the function and its parameters, None if it has none; a ValueError says what is wrong with either."""
        function = self.plugin.load()
        try:
            parameters = default_parameters(function)
        except (TypeError, ValueError) as error:
            raise PluginError(f"{self.plugin} is no method: {error}") from error
        if self.table is None or not self.table.settings:
            return function, parameters
        if parameters is None:
            raise ValueError(f"{self.table.place} {', '.join(self.table.settings)}: {self.plugin} has no parameters")
        with self.plugin.running(ValueError, failure=f"cannot take the parameters of {self.table.place}"):
            return function, self.table.changed(parameters)


@dataclass(frozen=True)
class GivenDepth:
    """The depth maps of the capture, as they are."""


DepthMethod = OurDepth | DepthProgram | Installed | GivenDepth
FusionMethod = OurFusion | FusionProgram | Installed


def _our_depths() -> dict[str, DepthMethod]:
    return {**{name: OurDepth(name, DEFAULTS[name]) for name in MATCHERS}, GIVEN: GivenDepth()}


def _our_fusions() -> dict[str, FusionMethod]:
    return {name: OurFusion(name) for name in FUSIONS}


@dataclass(frozen=True)
class Methods:
    """Depth and fusion methods by name; those of this program unless others are given.

    Parameters
    ----------
    depth, fusion : what the names stand for
    temporal : of depth methods that are not filtered in time as the run says
    """

    depth: Mapping[str, DepthMethod] = field(default_factory=_our_depths)
    fusion: Mapping[str, FusionMethod] = field(default_factory=_our_fusions)
    temporal: Mapping[str, TemporalParameters] = field(default_factory=dict)

    def check(self, depths: tuple[str, ...], fusions: tuple[str, ...]) -> None:
        """Raise a ValueError if one of these methods is not there, or is a plug-in that cannot be used."""
        for kind, names, known in (("depth", depths, self.depth), ("fusion", fusions, self.fusion)):
            for name in names:
                if name not in known:
                    raise ValueError(
                        f"unknown {kind} method {name!r}, expected one of {', '.join(known)}, "
                        "or one of a methods file (--methods)"
                    )
                method = known[name]
                if isinstance(method, Installed):
                    method.load()

    def temporal_of(self, depth: str, run: TemporalParameters | None) -> TemporalParameters | None:
        """Return how a depth method is filtered in time, in a run with these parameters; never if the run does not."""
        return None if run is None else self.temporal.get(depth, run)


def match(
    method: DepthMethod, pair: StereoPair, folder: Path, device: str = CPU, past: Past | None = None
) -> tuple[NDArray[np.float32], list[str]]:
    """Match a pair; returns the disparities of its left image and a sentence for each warning.

    Parameters
    ----------
    method : ours, a program or a plug-in
    pair : to match
    folder : where a program works; what is in it is removed
    device : where ours match, of `recon.depth.DEVICES`
    past : of the frames before, for PM

    Returns
    -------
    disparity : float32 (H, W), pixels, NaN where unmatched or masked out
    warnings : sentences

    Raises
    ------
    ValueError
        If the method does not match pairs, a program fails, or there is no GPU where one is asked for.
    """
    if isinstance(method, GivenDepth):
        raise ValueError(f"{GIVEN} takes the depth maps of a capture and matches no pairs; choose another method")
    if isinstance(method, DepthProgram):
        return match_by_program(pair, method, folder), []
    if isinstance(method, Installed):
        return _match_by_plugin(method, pair), []
    return matched(method.method, pair, method.parameters, device, past)


def is_pm(method: DepthMethod) -> bool:
    """Tell whether a method is PM or a variant of it, which starts from what it found in the frames before."""
    return isinstance(method, OurDepth) and isinstance(method.parameters, PmParameters)


def fuse(
    method: FusionMethod,
    clouds: Sequence[Cloud],
    run: SurfaceParameters,
    *,
    views: Sequence[DepthView] | None,
    folder: Path,
) -> tuple[Mesh, list[str]]:
    """Fuse the clouds of all sensors; returns the mesh and a sentence for each warning.

    Parameters
    ----------
    method : ours, a program or a plug-in
    clouds : one per sensor
    run : parameters of a surface in the run
    views : the clouds' points as depth maps, for methods that ask for them; None where cameras are not known
    folder : where a program works; what is in it is removed
    """
    if isinstance(method, FusionProgram):
        voxel = with_voxel(clouds, run).voxel_mm
        assert voxel is not None
        return fuse_by_program(clouds, method, voxel, folder), []
    if isinstance(method, Installed):
        return _fuse_by_plugin(method, clouds, run, views)
    return fused(FUSIONS[method.method], clouds, fusion_parameters(method, run), views)


def needs_views(method: FusionMethod) -> bool:
    """Tell whether a fusion works on depth maps."""
    if isinstance(method, FusionProgram):
        return False
    return asks_for_views(method.load()[0] if isinstance(method, Installed) else FUSIONS[method.method])


def fusion_parameters(method: OurFusion | Installed, run: SurfaceParameters) -> Any:
    """Return the parameters of a fusion in a run with these, None if it has none.

    Ours, FA and FB, take the run's; others take the run's voxel where they have a `voxel_mm` that is None.
    """
    if isinstance(method, Installed):
        return _with_voxel_of(run, method.load()[1])
    default = default_parameters(FUSIONS[method.method])
    base = run if isinstance(default, SurfaceParameters) else _with_voxel_of(run, default)
    return replace(base, **method.changes)


def depth_key(method: DepthMethod) -> dict[str, Any]:
    """Describe a depth method for a key, by what its result depends on."""
    if isinstance(method, DepthProgram):
        return _program_key(method)
    if isinstance(method, Installed):
        return _plugin_key(method, method.load()[1])
    return asdict(method)


def fusion_key(method: FusionMethod, run: SurfaceParameters) -> dict[str, Any]:
    """Describe a fusion for a key, by what its result depends on in a run with these parameters."""
    if isinstance(method, FusionProgram):
        return _program_key(method) | {"voxel_mm": run.voxel_mm}
    if isinstance(method, Installed):
        return _plugin_key(method, fusion_parameters(method, run))
    return {"method": method.method, "parameters": asdict(fusion_parameters(method, run))}


def with_limit(key: dict[str, Any], method: DepthMethod | FusionMethod) -> dict[str, Any]:
    """Add the time limit of a program to its key, to describe it for people."""
    return key | ({"timeout_s": method.timeout_s} if isinstance(method, DepthProgram | FusionProgram) else {})


def read_methods(path: Path | None) -> Methods:
    """Find all methods: after ours come those of installed packages, then those of a methods file, if there is one.

    Raises
    ------
    ValueError
        If the file cannot be read, or a name or a value in it cannot be used; it names the table and the key.
    """
    depth: dict[str, DepthMethod] = _our_depths()
    depth |= {name: Installed(plugin) for name, plugin in registered(DEPTH_GROUP, depth).items()}
    fusion: dict[str, FusionMethod] = _our_fusions()
    fusion |= {name: Installed(plugin) for name, plugin in registered(FUSION_GROUP, fusion).items()}
    depth_tables, fusion_tables = read_tables(path, "depth", depth), read_tables(path, "fusion", fusion)
    temporal = {name: table.part("temporal", TemporalParameters) for name, table in depth_tables.items()}
    return Methods(
        depth | {name: _depth_method(table.without("temporal"), depth) for name, table in depth_tables.items()},
        fusion | {name: _fusion_method(table, fusion) for name, table in fusion_tables.items()},
        {name: parameters for name, parameters in temporal.items() if parameters is not None},
    )


def _depth_method(table: Table, known: Mapping[str, DepthMethod]) -> DepthMethod:
    if table.is_program():
        return table.program(DepthProgram)
    method = known[table.method([name for name in known if name != GIVEN])]
    if isinstance(method, OurDepth):
        if isinstance(method.parameters, PmParameters) and table.content.get("seed") == NO_SEED:
            unseeded = replace(method.parameters, is_seeded=False)
            return OurDepth(method.method, table.without("seed").changed(unseeded))
        return OurDepth(method.method, table.changed(method.parameters))
    assert isinstance(method, Installed)
    return Installed(method.plugin, table)


def _fusion_method(table: Table, known: Mapping[str, FusionMethod]) -> FusionMethod:
    if table.is_program():
        return table.program(FusionProgram)
    method = known[table.method(known)]
    if isinstance(method, OurFusion):
        parameters = table.built(type(default_parameters(FUSIONS[method.method])))
        return OurFusion(method.method, {name: getattr(parameters, name) for name in table.settings})
    assert isinstance(method, Installed)
    return Installed(method.plugin, table)


def _match_by_plugin(method: Installed, pair: StereoPair) -> NDArray[np.float32]:
    """Match by a plug-in: float32 (H, W), pixels; what it finds outside the range or on the background is dropped."""
    function, parameters = method.load()
    with method.plugin.running():
        result = function(pair) if parameters is None else function(pair, parameters)
    expected = (pair.height, pair.width)
    if not isinstance(result, np.ndarray) or result.shape != expected or result.dtype.kind not in "fiu":
        shown = f"{result.dtype} {result.shape}" if isinstance(result, np.ndarray) else f"a {type(result).__name__}"
        raise PluginError(f"{method.plugin} returned {shown}, expected float32 {expected}")
    with np.errstate(over="ignore"):  # infinity is no disparity
        disparity = np.ma.filled(result.astype(np.float32), np.nan)
    try:
        check_range(pair, disparity)
    except ValueError as error:
        raise PluginError(f"{method.plugin}: {error}") from error
    return within_pair(pair, disparity)


def _fuse_by_plugin(
    method: Installed, clouds: Sequence[Cloud], run: SurfaceParameters, views: Sequence[DepthView] | None
) -> tuple[Mesh, list[str]]:
    function, _ = method.load()
    parameters = fusion_parameters(method, with_voxel(clouds, run))
    with method.plugin.running(NoSurfaceError):
        mesh, warnings = fused(function, clouds, parameters, views)
    if (shown := _no_mesh(mesh)) is not None:
        raise PluginError(
            f"{method.plugin} returned {shown}, expected a recon.geometry.mesh.Mesh with faces and coloured vertices"
        )
    try:
        check_place(mesh, clouds)
    except ValueError as error:
        raise PluginError(f"{method.plugin} returned a mesh in another place: {error}") from error
    return with_unit_normals(mesh), warnings


def _no_mesh(returned: object) -> str | None:
    """Say what a plug-in returned that is no mesh of a run; None where it is one."""
    if not isinstance(returned, Mesh):
        return f"a {type(returned).__name__}"
    if not len(returned.faces):
        return "a Mesh without faces"
    return None if returned.texture is None else "a Mesh with a texture"


def _with_voxel_of(run: SurfaceParameters, parameters: Any) -> Any:
    """Return parameters with the run's voxel, if they have one and leave it open."""
    has_voxel = parameters is not None and "voxel_mm" in {entry.name for entry in fields(parameters)}
    if has_voxel and parameters.voxel_mm is None:
        return replace(parameters, voxel_mm=run.voxel_mm)
    return parameters


def _program_key(method: Program) -> dict[str, Any]:
    folder = Path(method.folder)  # which may be moved, with the run
    files = {
        str(path.relative_to(folder) if path.is_relative_to(folder) else path): digest_once(path)
        for path in method.files()
    }
    return {"command": method.command, "output": method.output, "files": files}


def _plugin_key(method: Installed, parameters: Any) -> dict[str, Any]:
    plugin = method.plugin
    return {
        "plugin": plugin.name,
        "package": plugin.package,
        "version": plugin.version,
        "code": plugin.code_version(),
        "parameters": {} if parameters is None else asdict(parameters),
    }
