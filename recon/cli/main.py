"""The commands of reconstruction, which `app.cli` mounts.

Each command imports what it needs when it runs, so `--help` and the server never load numba or OpenCV.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import Any

import typer

from recon.cli.capture import app as capture_app
from recon.cli.commands.reconstruction import Export, Fuse, Match, Models, Reconstruct, Render
from recon.cli.console import ProgressLine, counted, print_result
from recon.cli.flags import with_settings
from recon.cli.kernels import DEPTH, RENDER, tell_of_compiling
from recon.cli.options import (
    MethodsCommand,
    find_methods,
    parse_approaches,
    parse_floor,
    parse_frames,
    parse_loops,
    parse_names,
    parse_path,
    parse_size,
)
from recon.cli.validate import app as validate_app
from recon.runtime.remote import address_of, is_copy

app = typer.Typer(no_args_is_help=True)
app.add_typer(capture_app, name="capture")
app.add_typer(validate_app, name="validate")


@app.command(cls=MethodsCommand)
@with_settings(Match)
def match(asked: Match, *, as_json: bool) -> None:
    """Match one rectified pair; unmatched pixels become NaN (npy, tiff) or inf (pfm)."""
    from recon.pipeline.reconstruct import match_files

    result = match_files(
        asked.left,
        asked.right,
        asked.out,
        method=asked.method,
        n_disparities=asked.disparities,
        min_disparity=asked.min_disparity,
        methods=find_methods(asked.methods),
        device=asked.device,
    )
    for warning in result["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    matched = f"{result['density']:.1%} of the pixels matched in {result['seconds']:.3f} s"
    print_result(result, f"{asked.method}: {matched}: {asked.out}", as_json=as_json)


@app.command(cls=MethodsCommand)
@with_settings(Reconstruct)
def reconstruct(asked: Reconstruct, *, as_json: bool) -> None:
    """Make depth maps, clouds and meshes of a capture by every approach."""
    with ProgressLine():  # what is loaded takes seconds
        from recon.capture.format import read_capture
        from recon.cloud import CloudParameters
        from recon.depth.temporal import TemporalParameters
        from recon.pipeline.job import ReconstructOptions
        from recon.pipeline.reconstruct import reconstruct_capture
        from recon.surface import SurfaceParameters

    capture = asked.capture
    options = asked.filled_in(
        ReconstructOptions,
        depths=parse_names(asked.depth or ""),
        fusions=parse_names(asked.fusion),
        colours=parse_names(asked.colour),
        further=parse_approaches(asked.approach),
        methods=find_methods(asked.methods),
        frames=parse_frames(asked.frames),
        temporal=TemporalParameters() if asked.temporal else None,
        surface=SurfaceParameters(voxel_mm=asked.voxel, longest_rim_mm=asked.close_holes),
        cloud=CloudParameters(erode_px=asked.erode),
        balance_colours=asked.balance,
        outlines=asked.outlines == "masks",
        fill_px=asked.fill,
    )
    with ProgressLine() as progress:
        tell_of_compiling(progress, DEPTH)
        recording = read_capture(capture.resolve())
        if not any(stream.mask for stream in recording.sensors):
            folder, where = ("FOLDER", " on a copy of it here") if is_copy(capture) else (shlex.quote(str(capture)), "")
            progress.say(
                f"{address_of(capture)} has no masks: all that stands in its bounds becomes part of the models, the "
                f"room, too; `reconstudy capture segment {folder}`{where} makes masks"
            )
        result = reconstruct_capture(recording, asked.out, options, progress)
        for warning in result["warnings"]:
            progress.say(f"warning: {warning}")
    made = f"{counted(len(result['frames']), 'frame')}, approaches {', '.join(result['approaches'])}"
    print_result(result, f"Reconstructed {result['dataset']} ({made}): {address_of(asked.out)}", as_json=as_json)


@app.command(cls=MethodsCommand)
@with_settings(Fuse)
def fuse(asked: Fuse, *, as_json: bool) -> None:
    """Make a mesh from point clouds, for example RUN/clouds/pm/S1/0000.ply."""
    from recon.geometry.mesh import check_resolved
    from recon.geometry.mesh_files import read_cloud, write_mesh
    from recon.pipeline.reconstruct import fuse_clouds
    from recon.runtime.files import check_not_read, check_suffix
    from recon.surface import SurfaceParameters

    check_suffix(asked.out, (".ply", ".glb"))
    check_not_read(asked.out, asked.clouds)
    parameters = SurfaceParameters(voxel_mm=asked.voxel, longest_rim_mm=asked.close_holes)
    sensors = [read_cloud(cloud) for cloud in asked.clouds]
    for path, cloud in zip(asked.clouds, sensors, strict=True):
        check_resolved(cloud.points, f"{path}: ")
    mesh, warnings = fuse_clouds(sensors, asked.fusion, parameters, methods=find_methods(asked.methods))
    write_mesh(asked.out, mesh)
    result = {"out": str(asked.out), "vertices": len(mesh.vertices), "faces": len(mesh.faces), "warnings": warnings}
    sentences = [*(f"warning: {warning}" for warning in warnings), f"Wrote {result['faces']} faces: {asked.out}"]
    print_result(result, "\n".join(sentences), as_json=as_json)


@app.command()
@with_settings(Export)
def export(asked: Export, *, as_json: bool) -> None:
    """Convert a model; a GLB file opens in any 3D viewer."""
    from recon.geometry.mesh import Mesh, error_colours, error_limit
    from recon.models.convert import DEFAULT_FPS, SEQUENCE, read_as_it_stands, size_of, write_model, write_sequence
    from recon.pipeline.run import recorded_fps
    from recon.runtime.files import check_not_read
    from recon.validation.clouds import read_shape
    from recon.validation.truth.evaluation import signed_distances_to

    if asked.limit is not None and asked.truth is None:
        raise typer.BadParameter("--limit is about errors: it needs --truth")
    if asked.sequence:
        if asked.truth is not None:
            raise typer.BadParameter("--sequence shows the models as they are; leave out --truth")
        fps = asked.fps or recorded_fps(asked.mesh) or DEFAULT_FPS
        with ProgressLine() as progress:
            n_frames, warnings = write_sequence(asked.out, asked.mesh, fps, progress)
        made: dict[str, Any] = {"out": str(asked.out), "frames": n_frames, "fps": fps, "warnings": warnings}
        for warning in warnings:
            typer.echo(f"warning: {warning}", err=True)
        wrote = f"Wrote {counted(n_frames, 'frame')}, {fps:g} a second: {asked.out / SEQUENCE}"
        print_result(made, f"{wrote}. Give Blender this frame rate before you import it", as_json=as_json)
        return
    check_not_read(asked.out, [asked.mesh] if asked.truth is None else [asked.mesh, asked.truth])
    read = read_as_it_stands(asked.mesh)
    model, (n_vertices, n_faces) = read.model, size_of(read.model)
    result: dict[str, Any] = {"out": str(asked.out), "vertices": n_vertices, "faces": n_faces}
    sentence = f"Wrote {result['vertices']} vertices and {result['faces']} faces: {asked.out}"
    if asked.truth is not None:
        if not isinstance(model, Mesh):
            raise ValueError(f"{asked.mesh}: holds no faces, on which errors could be shown; expected a mesh")
        true = read_shape(asked.truth)
        if not len(true.faces):
            raise ValueError(f"{asked.truth}: holds no faces, so that nothing is inside or outside; expected a mesh")
        errors = signed_distances_to(true, model.vertices)
        limit = error_limit(errors) if asked.limit is None else asked.limit
        model = replace(model, colours=error_colours(errors, limit), texture=None)
        result |= {"mean_mm": float(abs(errors).mean()), "limit_mm": limit}
        sentence += f"; {result['mean_mm']:.3g} mm from the truth on average, full colour at {limit:.3g} mm"
    write_model(asked.out, model)
    for warning in read.warnings:
        typer.echo(f"warning: {asked.mesh}: {warning}", err=True)
    print_result(result | {"warnings": list(read.warnings)}, sentence, as_json=as_json)


@app.command()
@with_settings(Models)
def models(asked: Models, *, as_json: bool) -> None:
    """Collect one frame's meshes and clouds of every approach, with their errors where the truth is known.

    `reconstudy study attach OUT` shows them in the dashboard, side by side.
    """
    from recon.validation.export_models import write_models

    with ProgressLine() as progress:
        written = write_models(asked.runs, asked.out, asked.frame, progress)
        others = sorted(
            {path for folder in {path.parent for path in written} for path in folder.glob("*.ply")} - {*written}
        )
        if others:
            names = ", ".join(path.relative_to(asked.out).as_posix() for path in others)
            progress.say(
                f"warning: {asked.out} has models from before, too: {names}; remove those that show something else"
            )
    result = {"out": str(asked.out), "models": [path.relative_to(asked.out).as_posix() for path in written]}
    print_result(result, f"Wrote {counted(len(written), 'model')}: {asked.out}", as_json=as_json)


@app.command()
@with_settings(Render)
def render(asked: Render, *, as_json: bool) -> None:
    """Render fly-through videos of every approach of every run and models folder, as a stimulus set."""
    with ProgressLine():  # what is loaded takes seconds
        from recon.pipeline.film import FLOORS, RenderOptions
        from recon.pipeline.render import render as render_folders
        from recon.render.camera_path import PATHS
        from recon.runtime.files import read_json

    every, loops = parse_loops(asked.loop, asked.static)
    options = asked.filled_in(
        RenderOptions,
        size=parse_size(asked.size),
        floor=parse_floor(asked.floor, FLOORS),
        path=parse_path(asked.path, PATHS),
        loop=every,
        loops=loops,
    )
    with ProgressLine() as progress:
        tell_of_compiling(progress, RENDER)
        manifest = render_folders(asked.folders, asked.out, options, progress, practice=asked.practice)
    content = read_json(manifest)
    stimuli = [*content["stimuli"], *content["practice"]]
    for warning in content["provenance"]["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    faults = [f"{stimulus['video']}: {fault}" for stimulus in stimuli for fault in stimulus["quality"]["faults"]]
    more = f" And {len(faults) - 1} more: the manifest lists them under `quality`." if len(faults) > 1 else ""
    below = [f"The encoder lost more than it should, so watch before you use: {faults[0]}.{more}"] if faults else []
    sentences = [f"Rendered {counted(len(stimuli), 'video')}: {address_of(manifest)}", *below]
    print_result({"manifest": address_of(manifest), "faults": faults}, "\n".join(sentences), as_json=as_json)
