"""The commands of reconstruction, which `app.cli` mounts.

Each command imports what it needs when it runs, so `--help` and the server never load numba or OpenCV.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from recon.cli.capture import app as capture_app
from recon.cli.console import JsonOption, ProgressLine, counted, print_result
from recon.cli.options import (
    PLUGIN_NAMES,
    ClusterOption,
    DeviceOption,
    FurtherOption,
    MethodsCommand,
    MethodsOption,
    WorkersOption,
    find_methods,
    parse_approaches,
    parse_frames,
    parse_loops,
    parse_names,
    parse_path,
    parse_place,
    parse_size,
)
from recon.cli.validate import app as validate_app
from recon.storage.remote import address_of, is_copy

OR_URL = "or an fsspec URL such as s3://BUCKET/NAME"

app = typer.Typer(no_args_is_help=True)
app.add_typer(capture_app, name="capture")
app.add_typer(validate_app, name="validate")


@app.command(cls=MethodsCommand)
def match(
    left: Annotated[Path, typer.Argument(help="Left image of a rectified pair, 8 bits.")],
    right: Annotated[Path, typer.Argument(help="Right image, of the same size.")],
    disparities: Annotated[int, typer.Option(help="How many disparities to search.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="File to write: .pfm, .npy, .tiff, or .png for a coloured preview.")
    ],
    method: Annotated[
        str, typer.Option(help=f"Depth method: id, dr, pm, sgm, {PLUGIN_NAMES}, or one of --methods.")
    ] = "id",
    min_disparity: Annotated[int, typer.Option(help="Smallest disparity to search.")] = 0,
    methods: MethodsOption = None,
    device: DeviceOption = "cpu",
    as_json: JsonOption = False,
) -> None:
    """Match one rectified pair; unmatched pixels become NaN (npy, tiff) or inf (pfm)."""
    from recon.pipeline.reconstruct import match_files

    result = match_files(
        left,
        right,
        out,
        method=method,
        n_disparities=disparities,
        min_disparity=min_disparity,
        methods=find_methods(methods),
        device=device,
    )
    for warning in result["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    sentence = f"{method}: {result['density']:.1%} of the pixels matched in {result['seconds']:.3f} s: {out}"
    print_result(result, sentence, as_json=as_json)


@app.command(cls=MethodsCommand)
def reconstruct(
    capture: Annotated[
        Path, typer.Argument(parser=parse_place, metavar="CAPTURE", help=f"Folder of the capture, {OR_URL}.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            parser=parse_place,
            metavar="PATH",
            help=f"Folder of the run, {OR_URL}; a run that was stopped is resumed.",
        ),
    ],
    depth: Annotated[
        str | None,
        typer.Option(
            help="Depth methods, comma-separated: id, dr, pm, sgm, given (the capture's own depth maps), "
            f"{PLUGIN_NAMES}, those of --methods. Default: id,dr,pm; given if the capture holds only depth maps.",
        ),
    ] = None,
    fusion: Annotated[
        str, typer.Option(help=f"Fusions, comma-separated: fa, fb, poisson, tsdf, {PLUGIN_NAMES}, those of --methods.")
    ] = "fa,fb",
    colour: Annotated[
        str,
        typer.Option(
            help="Where models take colours from, comma-separated: vertices (averaged as the surface is) and "
            "photographs (a texture as sharp as the pictures)."
        ),
    ] = "vertices",
    approach: FurtherOption = "",
    methods: MethodsOption = None,
    frames: Annotated[str | None, typer.Option(help="A:B for the frames A to B-1; default: all.")] = None,
    voxel: Annotated[
        float | None, typer.Option(help="Voxel size, mm; default: chosen from the depth resolution.")
    ] = None,
    temporal: Annotated[bool, typer.Option(help="Filter the depth maps in time to reduce flicker.")] = True,
    balance: Annotated[bool, typer.Option("--balance-colours", help="Make the sensors' colours agree.")] = False,
    close_holes: Annotated[
        float, typer.Option(min=0, help="Close holes whose rim is no longer than this, mm; default: leave them open.")
    ] = 0.0,
    erode: Annotated[
        int, typer.Option(min=0, help="Pixels to cut off along the masks' edges, for masks that reach past the object.")
    ] = 0,
    outlines: Annotated[
        Literal["masks", "off"],
        typer.Option(help="masks: surfaces end where the masks of all sensors do; off: where their points do."),
    ] = "masks",
    workers: WorkersOption = 1,
    cluster: ClusterOption = None,
    device: DeviceOption = "cpu",
    as_json: JsonOption = False,
) -> None:
    """Make depth maps, clouds and meshes of a capture by every approach."""
    from recon.capture.format import read_capture
    from recon.cloud import CloudParameters
    from recon.depth.temporal import TemporalParameters
    from recon.pipeline.job import ReconstructOptions
    from recon.pipeline.reconstruct import reconstruct_capture
    from recon.surface import SurfaceParameters

    options = ReconstructOptions(
        depths=parse_names(depth or ""),
        fusions=parse_names(fusion),
        colours=parse_names(colour),
        further=parse_approaches(approach),
        methods=find_methods(methods),
        frames=parse_frames(frames),
        temporal=TemporalParameters() if temporal else None,
        surface=SurfaceParameters(voxel_mm=voxel, longest_rim_mm=close_holes),
        cloud=CloudParameters(erode_px=erode),
        balance_colours=balance,
        outlines=outlines == "masks",
        workers=workers,
        cluster=cluster,
        device=device,
    )
    progress = ProgressLine()
    recording = read_capture(capture.resolve())
    if not any(stream.mask for stream in recording.sensors):
        folder, where = ("FOLDER", " on a copy of it here") if is_copy(capture) else (shlex.quote(str(capture)), "")
        progress.say(
            f"{address_of(capture)} has no masks: all that stands in its bounds becomes part of the models, the room, "
            f"too; `reconstudy capture segment {folder}`{where} makes masks"
        )
    result = reconstruct_capture(recording, out, options, progress)
    for warning in result["warnings"]:
        progress.say(f"warning: {warning}")
    progress.close()
    made = f"{counted(len(result['frames']), 'frame')}, approaches {', '.join(result['approaches'])}"
    print_result(result, f"Reconstructed {result['dataset']} ({made}): {address_of(out)}", as_json=as_json)


@app.command(cls=MethodsCommand)
def fuse(
    clouds: Annotated[list[Path], typer.Argument(help="PLY files of coloured, oriented points in mm, one per sensor.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .ply or .glb.")],
    fusion: Annotated[
        str,
        typer.Option(
            help="fb: one surface from all clouds; fa: a surface from each cloud, then merged; poisson: screened "
            f"Poisson; {PLUGIN_NAMES}, or one of --methods."
        ),
    ] = "fb",
    methods: MethodsOption = None,
    voxel: Annotated[
        float | None, typer.Option(help="Voxel size, mm; default: chosen from the points' spacing.")
    ] = None,
    close_holes: Annotated[float, typer.Option(min=0, help="Close holes whose rim is no longer than this, mm.")] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Make a mesh from point clouds, for example RUN/clouds/pm/S1/0000.ply."""
    from recon.geometry.mesh import check_resolved
    from recon.geometry.mesh_files import read_cloud, write_mesh
    from recon.pipeline.reconstruct import fuse_clouds
    from recon.storage.files import check_not_read, check_suffix
    from recon.surface import SurfaceParameters

    check_suffix(out, (".ply", ".glb"))
    check_not_read(out, clouds)
    parameters = SurfaceParameters(voxel_mm=voxel, longest_rim_mm=close_holes)
    sensors = [read_cloud(cloud) for cloud in clouds]
    for path, cloud in zip(clouds, sensors, strict=True):
        check_resolved(cloud.points, f"{path}: ")
    mesh, warnings = fuse_clouds(sensors, fusion, parameters, methods=find_methods(methods))
    write_mesh(out, mesh)
    result = {"out": str(out), "vertices": len(mesh.vertices), "faces": len(mesh.faces), "warnings": warnings}
    sentences = [*(f"warning: {warning}" for warning in warnings), f"Wrote {result['faces']} faces: {out}"]
    print_result(result, "\n".join(sentences), as_json=as_json)


@app.command()
def export(
    mesh: Annotated[
        Path,
        typer.Argument(help="A mesh of a run, such as RUN/meshes/pm_fb/0000.ply, or a PLY with normals and colours."),
    ],
    out: Annotated[
        Path,
        typer.Argument(help="File to write: .glb for viewers and the web, .ply, or .obj of a mesh with a texture."),
    ],
    truth: Annotated[
        Path | None,
        typer.Option(help="The true mesh, PLY, OBJ or glTF; colours then show the error, red outside, blue inside."),
    ] = None,
    limit: Annotated[
        float | None, typer.Option(help="Error that gets the full colour, mm; default: 95 % of the vertices have less.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Convert a mesh; a GLB file opens in any 3D viewer."""
    from recon.geometry.mesh import error_colours, error_limit
    from recon.geometry.mesh_files import read_mesh, write_mesh
    from recon.storage.files import check_not_read
    from recon.validation.clouds import read_shape
    from recon.validation.truth.evaluation import signed_distances_to

    if limit is not None and truth is None:
        raise typer.BadParameter("--limit is about errors: it needs --truth")
    check_not_read(out, [mesh] if truth is None else [mesh, truth])
    model = read_mesh(mesh)
    result: dict[str, Any] = {"out": str(out), "vertices": len(model.vertices), "faces": len(model.faces)}
    sentence = f"Wrote {result['vertices']} vertices and {result['faces']} faces: {out}"
    if truth is not None:
        true = read_shape(truth)
        if not len(true.faces):
            raise ValueError(f"{truth}: holds no faces, so that nothing is inside or outside; expected a mesh")
        errors = signed_distances_to(true, model.vertices)
        limit = error_limit(errors) if limit is None else limit
        model = replace(model, colours=error_colours(errors, limit), texture=None)
        result |= {"mean_mm": float(abs(errors).mean()), "limit_mm": limit}
        sentence += f"; {result['mean_mm']:.3g} mm from the truth on average, full colour at {limit:.3g} mm"
    write_mesh(out, model)
    print_result(result, sentence, as_json=as_json)


@app.command()
def models(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, one per scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the models.")],
    frame: Annotated[int | None, typer.Option(help="Number of the frame; default: the middle one.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Collect one frame's meshes and clouds of every approach, with their errors where the truth is known.

    `reconstudy study attach OUT` shows them in the dashboard, side by side.
    """
    from recon.export_models import write_models

    progress = ProgressLine()
    written = write_models(runs, out, frame, progress)
    others = sorted(
        {path for folder in {path.parent for path in written} for path in folder.glob("*.ply")} - {*written}
    )
    if others:
        names = ", ".join(path.relative_to(out).as_posix() for path in others)
        progress.say(f"warning: {out} has models from before, too: {names}; remove those that show something else")
    progress.close()
    result = {"out": str(out), "models": [path.relative_to(out).as_posix() for path in written]}
    print_result(result, f"Wrote {len(written)} models: {out}", as_json=as_json)


@app.command()
def render(
    folders: Annotated[
        list[Path],
        typer.Argument(
            parser=parse_place,
            metavar="RUN|MODELS",
            help=f"Runs, each a folder {OR_URL}, and folders of models by other programs, each with a scene.json. All "
            "of one scene are filmed alike.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", parser=parse_place, metavar="PATH", help=f"Folder of the stimulus set, {OR_URL}."),
    ],
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT, pixels.")] = "1920x1080",
    fps: Annotated[float, typer.Option(min=1, max=120, help="Frames a second.")] = 25.0,
    seconds: Annotated[float, typer.Option(min=0.04, help="Length of every video.")] = 15.0,
    background: Annotated[str, typer.Option(help="Artificial background: studio, dark or plain.")] = "studio",
    path: Annotated[
        str,
        typer.Option(
            metavar="sensors|orbit|swing|FILE",
            help="The camera's way: along the sensors, once around, to both sides of the first sensor, or as in a JSON "
            "file like the SET/paths/DATASET.json that this writes. auto: sensors, or swing where there is only one.",
        ),
    ] = "auto",
    loop: Annotated[
        list[str],
        typer.Option(
            metavar="[APPROACH=]repeat|bounce|static",
            help="How a short recording fills the video: again from the start, back and forth, or by its first model "
            "alone; for one approach by its name, again and again.",
        ),
    ] = ["bounce"],  # noqa: B006  # typer copies it
    static: Annotated[
        str, typer.Option(metavar="APPROACH,APPROACH,...", help="Approaches that show their first model alone.")
    ] = "",
    renderer: Annotated[str, typer.Option(help="Renderer: auto or a name.")] = "auto",
    master: Annotated[bool, typer.Option(help="Keep a near-lossless master beside each video.")] = True,
    practice: Annotated[
        str, typer.Option(metavar="DATASET", help="Scene with two videos that a study's participants practise with.")
    ] = "",
    workers: WorkersOption = 1,
    cluster: ClusterOption = None,
    as_json: JsonOption = False,
) -> None:
    """Render fly-through videos of every approach of every run and models folder, as a stimulus set."""
    from recon.pipeline.film import RenderOptions
    from recon.pipeline.render import render as render_folders
    from recon.render.camera_path import PATHS
    from recon.storage.files import read_json

    every, loops = parse_loops(loop, static)
    options = RenderOptions(
        size=parse_size(size),
        fps=fps,
        seconds=seconds,
        background=background,
        path=parse_path(path, PATHS),
        loop=every,
        loops=loops,
        renderer=renderer,
        master=master,
        workers=workers,
        cluster=cluster,
    )
    progress = ProgressLine()
    manifest = render_folders(folders, out, options, progress, practice=practice)
    progress.close()
    content = read_json(manifest)
    stimuli = [*content["stimuli"], *content["practice"]]
    for warning in content["provenance"]["warnings"]:
        typer.echo(f"warning: {warning}", err=True)
    faults = [f"{stimulus['video']}: {fault}" for stimulus in stimuli for fault in stimulus["quality"]["faults"]]
    more = f", as {len(faults) - 1} more like it in `quality` of the manifest" if len(faults) > 1 else ""
    below = [f"The encoder lost more than it should, so watch before you use: {faults[0]}{more}"] if faults else []
    sentences = [f"Rendered {len(stimuli)} videos: {address_of(manifest)}", *below]
    print_result({"manifest": address_of(manifest), "faults": faults}, "\n".join(sentences), as_json=as_json)
