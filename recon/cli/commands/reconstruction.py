"""The settings of the commands from a pair of images to films."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from recon.cli.commands.setting import NAMES, OR_URL, OUT, PLUGIN_NAMES, Command, argument, option
from recon.cli.commands.shared import APPROACHES, CLUSTER, DEVICE, FRAMES, METHODS, PRACTICE, WORKERS


class Match(Command):
    """Of `match`."""

    left: Path = argument("Left image of a rectified pair, 8 bits.")
    right: Path = argument("Right image, of the same size.")
    disparities: int = option(..., "How many disparities to search.", ge=1)
    out: Path = option(..., "File to write: .pfm, .npy, .tiff, or .png for a coloured preview.", flags=OUT)
    method: str = option("id", f"Depth method: id, dr, pm, sgm, {PLUGIN_NAMES}, or one of --methods.")
    min_disparity: int = option(0, "Smallest disparity to search.")
    methods: Path | None = METHODS
    device: Literal["cpu", "gpu"] = DEVICE


class Reconstruct(Command):
    """Of `reconstruct`."""

    capture: Path = argument(f"Folder of the capture, {OR_URL}.", metavar="CAPTURE", is_place=True)
    out: Path = option(
        ...,
        f"Folder of the run, {OR_URL}; a run that was stopped is resumed.",
        flags=OUT,
        metavar="PATH",
        is_place=True,
    )
    depth: str | None = option(
        None,
        f"Depth methods, comma-separated: id, dr, pm, sgm, given (the capture's own depth maps), {PLUGIN_NAMES}, "
        "those of --methods. Default: id,dr,pm; given if the capture holds only depth maps.",
        label="Depth methods",
        note="none chosen: id, dr and pm, or given if the capture holds depth maps alone",
        choices={
            "id": "whole disparities, the quickest",
            "dr": "disparities refined",
            "pm": "PatchMatch, the slowest",
            "sgm": "semi-global matching, to compare with",
            "given": "the capture's own depth maps",
        },
        is_several=True,
    )
    fusion: str = option(
        "fa,fb",
        f"Fusions, comma-separated: fa, fb, poisson, tsdf, {PLUGIN_NAMES}, those of --methods.",
        label="Fusions",
        note="none chosen: fa and fb",
        choices={
            "fa": "a surface of each sensor, then merged",
            "fb": "one surface of all sensors",
            "poisson": "screened Poisson, to compare with",
            "tsdf": "signed distances in voxels, to compare with",
        },
        is_several=True,
    )
    colour: str = option(
        "photographs",
        "Where models take colours from, comma-separated: photographs (a texture as sharp as the pictures) and "
        "vertices (averaged as the surface is, as in the paper).",
        label="Colours",
        note="none chosen: photographs",
        choices={
            "photographs": "a texture as sharp as the pictures",
            "vertices": "averaged as the surface is, as in the paper",
        },
        is_several=True,
    )
    approach: str = APPROACHES
    methods: Path | None = METHODS
    frames: str | None = option(None, "How many, from the first on, or A:B for A to B-1; default: all.", **FRAMES)
    voxel: float | None = option(
        None,
        "Voxel size, mm, the same for all depth methods; default: each gets one from its depth error and the points' "
        "spacing.",
        label="Voxel",
        low=0.01,
        high=10000,
        gt=0,
    )
    pm: Literal["moving", "static"] = option(
        "moving",
        "What PM makes: moving, models of all frames; static, of the first alone, as the paper showed it.",
        label="PM's models",
        choices={"moving": "of all frames", "static": "of the first frame alone, as the paper showed it"},
    )
    temporal: bool = option(True, "Filter the depth maps in time to reduce flicker.", label="Filter depth in time")
    balance: bool = option(
        False, "Make the sensors' colours agree.", label="Balance colours", flags=("--balance-colours",)
    )
    close_holes: float = option(
        0.0,
        "Close holes whose rim is no longer than this, mm; default: leave them open.",
        ge=0,
        label="Close holes",
        high=100_000,
    )
    erode: int = option(
        0,
        "Pixels to cut off along the masks' edges, for masks that reach past the object.",
        ge=0,
        label="Cut off at masks",
        high=100,
    )
    outlines: Literal["masks", "off"] = option(
        "masks", "masks: surfaces end where the masks of all sensors do; off: where their points do."
    )
    agreement: bool = option(
        True,
        "Hold the sensors' points against each other before they are fused: what others contradict goes, what they "
        "measured, too, is averaged.",
        label="Let sensors agree",
    )
    clouds: Literal["few", "all"] = option(
        "few",
        "Clouds that stay on disk: few, of the first and the middle frame, while others are made when they are needed; "
        "all.",
        label="Clouds that stay",
        choices={"few": "of the first and the middle frame", "all": "of all frames"},
    )
    meshes: Literal["plain", "packed"] = option(
        "plain",
        "How meshes are stored: plain, as PLY and GLB; packed, in less than half of the space, but for the first and "
        "the middle frame. All commands read both.",
        label="Meshes on the disk",
        choices={"plain": "as PLY and GLB", "packed": "packed, but for the first and the middle frame"},
    )
    steady: int = option(
        2,
        "With the rims of how many frames before and after a surface's own rims are averaged, so that they flicker "
        "less; models with coloured vertices stay as they are. 0: none.",
        ge=0,
        label="Steady rims",
        high=8,
    )
    fill: int = option(
        16,
        "Continue surfaces where a mask shows the object and nothing was measured, up to so many pixels; 0: leave "
        "such holes. Their vertices are marked. Surfaces must end at the masks, as they do unless told otherwise.",
        ge=0,
        label="Fill holes",
        high=200,
    )
    workers: int = WORKERS
    cluster: str | None = CLUSTER
    device: Literal["cpu", "gpu"] = DEVICE


class Fuse(Command):
    """Of `fuse`."""

    clouds: list[Path] = argument("PLY files of coloured, oriented points in mm, one per sensor.")
    out: Path = option(..., "File to write: .ply or .glb.", flags=OUT)
    fusion: str = option(
        "fb",
        "fb: one surface from all clouds; fa: a surface from each cloud, then merged; poisson: screened "
        f"Poisson; {PLUGIN_NAMES}, or one of --methods.",
    )
    methods: Path | None = METHODS
    voxel: float | None = option(None, "Voxel size, mm; default: chosen from the points' spacing.", gt=0)
    close_holes: float = option(0.0, "Close holes whose rim is no longer than this, mm.", ge=0)


class Export(Command):
    """Of `export`."""

    mesh: Path = argument(
        "A mesh of a run, such as RUN/meshes/pm_fb/0000.ply, or any model that `render` reads.", metavar="MODEL"
    )
    out: Path = argument("File to write: .glb for viewers and the web, .ply, or .obj of a mesh with a texture.")
    truth: Path | None = option(None, "The true mesh; colours then show the error, red outside, blue inside.")
    limit: float | None = option(
        None, "Error that gets the full colour, mm; default: 95 % of the vertices have less.", gt=0
    )
    sequence: bool = option(
        False,
        "Write all frames of a folder as one glTF that shows them in turn, into the folder OUT.",
        flags=("--sequence",),
    )
    fps: float | None = option(
        None, "Frames a second of the sequence; default: as the run was recorded, 25 without one.", ge=0.01
    )


class Models(Command):
    """Of `models`."""

    runs: list[Path] = argument("Folders of runs, one per scene.")
    out: Path = option(..., "Folder for the models.", flags=OUT)
    frame: int | None = option(None, "Number of the frame; default: the middle one.", ge=0)


class Render(Command):
    """Of `render`."""

    folders: list[Path] = argument(
        f"Runs, each a folder {OR_URL}, and folders of models by other programs, each with a scene.json. All of one "
        "scene are filmed alike.",
        metavar="RUN|MODELS",
        is_place=True,
    )
    out: Path = option(..., f"Folder of the stimulus set, {OR_URL}.", flags=OUT, metavar="PATH", is_place=True)
    size: str = option(
        "1920x1080",
        "WIDTHxHEIGHT, pixels.",
        label="Size",
        note="WIDTHxHEIGHT, pixels, both even",
        form=r"[1-9]\d{0,2}[02468]x[1-9]\d{0,2}[02468]",
        example="1920x1080",
    )
    fps: float = option(25.0, "Frames a second.", ge=1, le=120, label="Frames a second")
    seconds: float = option(15.0, "Length of every video.", ge=0.04, label="Seconds", high=600)
    background: str = option(
        "studio",
        "Artificial background: studio, dark or plain.",
        label="Background",
        choices={"studio": "a bright studio", "dark": "a dark room", "plain": "one colour"},
    )
    floor: str = option(
        "model",
        "Height of the floor in all films of a scene: where its models stand, the bottom of the bounds, or a number in "
        "mm; the manifest tells it.",
        label="Floor",
        note="",
        metavar="model|bounds|MM",
        choices={"model": "where the models stand", "bounds": "at the bottom of the bounds"},
    )
    light: str = option(
        "studio",
        "Light on meshes and clouds: studio, or flat for the colours that they bring, so that light is no giveaway "
        "beside Gaussian splats, which always bring theirs.",
        label="Light",
        note="",
        choices={"studio": "from the background, with shadows on the models", "flat": "none: the colours as they come"},
    )
    path: str = option(
        "auto",
        "The camera's way: along the sensors, once around, to both sides of the first sensor, or as in a JSON file "
        "like the SET/paths/DATASET.json that this writes. auto: sensors, or swing where there is only one.",
        label="Camera's way",
        note="",
        metavar="sensors|orbit|swing|FILE",
        choices={
            "auto": "along the sensors, or to both sides of a single one",
            "sensors": "along the sensors",
            "orbit": "once around",
            "swing": "to both sides of the first sensor",
        },
    )
    loop: list[str] = option(
        ["bounce"],
        "How a short recording fills the video: again from the start, back and forth, or by its first model alone; "
        "for one approach by its name, again and again.",
        label="A short recording",
        note="",
        metavar="[APPROACH=]repeat|bounce|static",
        choices={"bounce": "plays back and forth", "repeat": "starts again", "static": "shows its first model alone"},
    )
    static: str = option(
        "",
        "Approaches that show their first model alone.",
        label="Still approaches",
        note="approaches of one model beside others that move, with commas",
        metavar="APPROACH,APPROACH,...",
        form=NAMES,
        example="scan",
    )
    renderer: str = option(
        "auto", "Renderer: auto, software, pyrender (OpenGL), or gsplat (Gaussian splats on an NVIDIA GPU)."
    )
    master: bool = option(True, "Keep a near-lossless master beside each video.")
    practice: str = option(
        "", "Scene with two videos that a study's participants practise with.", metavar="DATASET", **PRACTICE
    )
    workers: int = WORKERS
    cluster: str | None = CLUSTER
