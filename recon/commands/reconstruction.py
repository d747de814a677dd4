"""The settings of the commands from a pair of images to films."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from recon.commands.setting import NAMES, OR_URL, PLUGIN_NAMES, Argument, Command, Setting
from recon.commands.shared import FRAMES, PRACTICE, Approaches, Cluster, Device, Methods, Workers, out


class Match(Command):
    """Of `match`."""

    left: Annotated[Path, Argument("Left image of a rectified pair, 8 bits.")]
    right: Annotated[Path, Argument("Right image, of the same size.")]
    disparities: Annotated[int, Setting("How many disparities to search.")]
    out: Annotated[Path, out("File to write: .pfm, .npy, .tiff, or .png for a coloured preview.")]
    method: Annotated[str, Setting(f"Depth method: id, dr, pm, sgm, {PLUGIN_NAMES}, or one of --methods.")] = "id"
    min_disparity: Annotated[int, Setting("Smallest disparity to search.")] = 0
    methods: Methods = None
    device: Device = "cpu"


class Reconstruct(Command):
    """Of `reconstruct`."""

    capture: Annotated[Path, Argument(f"Folder of the capture, {OR_URL}.", metavar="CAPTURE", is_place=True)]
    out: Annotated[
        Path,
        Setting(
            f"Folder of the run, {OR_URL}; a run that was stopped is resumed.",
            flags=("--out", "-o"),
            metavar="PATH",
            is_place=True,
        ),
    ]
    depth: Annotated[
        str | None,
        Setting(
            "Depth methods, comma-separated: id, dr, pm, sgm, given (the capture's own depth maps), "
            f"{PLUGIN_NAMES}, those of --methods. Default: id,dr,pm; given if the capture holds only depth maps.",
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
        ),
    ] = None
    fusion: Annotated[
        str,
        Setting(
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
        ),
    ] = "fa,fb"
    colour: Annotated[
        str,
        Setting(
            "Where models take colours from, comma-separated: vertices (averaged as the surface is) and "
            "photographs (a texture as sharp as the pictures).",
            label="Colours",
            note="none chosen: vertices",
            choices={
                "vertices": "averaged as the surface is",
                "photographs": "a texture as sharp as the pictures",
            },
            is_several=True,
        ),
    ] = "vertices"
    approach: Approaches = ""
    methods: Methods = None
    frames: Annotated[str | None, FRAMES] = None
    voxel: Annotated[
        float | None,
        Setting(
            "Voxel size, mm; default: chosen from the depth resolution.",
            label="Voxel",
            note="size, mm; empty: chosen from the depth resolution",
            low=0.01,
            high=10_000,
        ),
    ] = None
    temporal: Annotated[
        bool,
        Setting(
            "Filter the depth maps in time to reduce flicker.", label="Filter depth in time", note="reduces flicker"
        ),
    ] = True
    balance: Annotated[
        bool,
        Setting(
            "Make the sensors' colours agree.",
            label="Balance colours",
            note="makes the sensors' colours agree",
            flags=("--balance-colours",),
        ),
    ] = False
    close_holes: Annotated[
        float,
        Setting(
            "Close holes whose rim is no longer than this, mm; default: leave them open.",
            label="Close holes",
            note="whose rim is no longer than this, mm; empty: leave them open",
            high=100_000,
        ),
    ] = Field(0.0, ge=0)
    erode: Annotated[
        int,
        Setting(
            "Pixels to cut off along the masks' edges, for masks that reach past the object.",
            label="Cut off at masks",
            note="pixels along the masks' edges; empty: none",
            high=100,
        ),
    ] = Field(0, ge=0)
    outlines: Annotated[
        Literal["masks", "off"],
        Setting("masks: surfaces end where the masks of all sensors do; off: where their points do."),
    ] = "masks"
    workers: Workers = 1
    cluster: Cluster = None
    device: Device = "cpu"


class Render(Command):
    """Of `render`."""

    folders: Annotated[
        list[Path],
        Argument(
            f"Runs, each a folder {OR_URL}, and folders of models by other programs, each with a scene.json. All "
            "of one scene are filmed alike.",
            metavar="RUN|MODELS",
            is_place=True,
        ),
    ]
    out: Annotated[
        Path, Setting(f"Folder of the stimulus set, {OR_URL}.", flags=("--out", "-o"), metavar="PATH", is_place=True)
    ]
    size: Annotated[
        str,
        Setting(
            "WIDTHxHEIGHT, pixels.",
            label="Size",
            note="WIDTHxHEIGHT, pixels, both even",
            form=r"[1-9]\d{0,2}[02468]x[1-9]\d{0,2}[02468]",
            example="1920x1080",
        ),
    ] = "1920x1080"
    fps: Annotated[float, Setting("Frames a second.", label="Frames a second", note="")] = Field(25.0, ge=1, le=120)
    seconds: Annotated[float, Setting("Length of every video.", label="Seconds", note="of every film", high=600)] = (
        Field(15.0, ge=0.04)
    )
    background: Annotated[
        str,
        Setting(
            "Artificial background: studio, dark or plain.",
            label="Background",
            note="",
            choices={"studio": "a bright studio", "dark": "a dark room", "plain": "one colour"},
        ),
    ] = "studio"
    path: Annotated[
        str,
        Setting(
            "The camera's way: along the sensors, once around, to both sides of the first sensor, or as in a JSON "
            "file like the SET/paths/DATASET.json that this writes. auto: sensors, or swing where there is only one.",
            label="Camera's way",
            note="",
            metavar="sensors|orbit|swing|FILE",
            choices={
                "auto": "along the sensors, or to both sides of a single one",
                "sensors": "along the sensors",
                "orbit": "once around",
                "swing": "to both sides of the first sensor",
            },
        ),
    ] = "auto"
    loop: Annotated[
        list[str],
        Setting(
            "How a short recording fills the video: again from the start, back and forth, or by its first model "
            "alone; for one approach by its name, again and again.",
            label="A short recording",
            note="",
            metavar="[APPROACH=]repeat|bounce|static",
            choices={
                "bounce": "plays back and forth",
                "repeat": "starts again",
                "static": "shows its first model alone",
            },
        ),
    ] = Field(["bounce"])
    static: Annotated[
        str,
        Setting(
            "Approaches that show their first model alone.",
            label="Still approaches",
            note="approaches of one model beside others that move, with commas",
            metavar="APPROACH,APPROACH,...",
            form=NAMES,
            example="scan",
        ),
    ] = ""
    renderer: Annotated[str, Setting("Renderer: auto or a name.")] = "auto"
    master: Annotated[bool, Setting("Keep a near-lossless master beside each video.")] = True
    practice: Annotated[
        str,
        replace(PRACTICE, help="Scene with two videos that a study's participants practise with.", metavar="DATASET"),
    ] = ""
    workers: Workers = 1
    cluster: Cluster = None
