"""The settings of the commands of objective evaluation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from pydantic import Field

from recon.commands.setting import NAME, NAMES, Argument, Command, Setting
from recon.commands.shared import FRAMES, Workers, out

EVERY_DATASET = "all"
UNIT = Setting(
    "Unit of PLY, OBJ and text: mm, cm, m or in.",
    label="Unit",
    note="of the clouds",
    choices={"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"},
)
Report = Annotated[Path, out("Folder of the report.")]
Dataset = Annotated[
    str,
    Setting(
        "Scene of a study that the results are for; all: every scene.",
        label="Dataset",
        note="scene of a study that the results are for; empty: every scene",
        form=NAME,
        example="ball",
        is_blank=True,
    ),
]
Approach = Annotated[
    list[str] | None,
    Setting(
        "Approach of a study that the results are for, such as pm_fb; may be repeated.",
        label="Approach",
        note="approach of a study that the results are for; empty: none",
        form=NAME,
        example="pm_fb",
    ),
]
Sensors = Annotated[
    list[str] | None,
    Setting(
        "Sensor of each cloud, in order; fewer names than clouds repeat.",
        label="Sensors",
        note="names for the clouds, in their order; fewer names than clouds repeat; empty: one sensor saw all of them",
        flags=("--sensor",),
        form=NAMES,
        example="S1,S2",
    ),
]
Thresholds = Annotated[
    str,
    Setting(
        "Thresholds of the inlier curve, mm: FROM:TO or FROM:TO:STEP.",
        label="Thresholds",
        note="of the share of inliers, mm, FROM:TO or FROM:TO:STEP",
        form=r"\d+(?:\.\d+)?(?::\d+(?:\.\d+)?){1,2}",
        example="5:100",
        is_blank=True,
    ),
]
Seed = Annotated[int, Setting("Seed of the random samples; the same seed gives the same report."), Field(ge=0)]
Unit = Annotated[str, UNIT]


class ValidateSphere(Command):
    """Of `validate sphere`."""

    clouds: Annotated[list[Path], Argument("PLY, OBJ, glTF, or text with x y z; one file per sensor and placed ball.")]
    radius: Annotated[float, Setting("Radius of the ball, mm.", label="Radius", note="mm", low=0.001, high=1e6)]
    out: Report
    sensors: Sensors = None
    method: Annotated[str, Setting("How to find the sphere: robust or super4pcs.")] = "robust"
    thresholds: Thresholds = "5:100"
    unit: Unit = "mm"
    viewpoint: Annotated[
        list[str] | None,
        Setting("[SENSOR=]x,y,z of a sensor, mm; then only points in front of or behind the ball count."),
    ] = None
    keep: Annotated[list[str] | None, Setting("SAMPLE/SENSOR to use although the rule excludes it.")] = None
    drop: Annotated[list[str] | None, Setting("SAMPLE/SENSOR to leave out although the rule keeps it.")] = None
    reference_centre: Annotated[
        list[Path] | None,
        Setting(
            "Another instrument's scan of the ball, such as a LiDAR's, once per placed ball in order; or one text "
            "file with a centre x y z a line."
        ),
    ] = None
    reference_unit: Annotated[str, Setting("Unit of the reference: mm, cm, m or in.")] = "mm"
    reference_frame: Annotated[
        str, Setting("own: the reference has a frame of its own, which is estimated; sensors: the clouds'.")
    ] = "own"
    dataset: Dataset = EVERY_DATASET
    approach: Approach = None
    seed: Seed = 1


class ValidateCuboid(Command):
    """Of `validate cuboid`."""

    clouds: Annotated[
        list[Path], Argument("PLY, OBJ, glTF, or text with x y z; one file per sensor and placed cuboid.")
    ]
    size: Annotated[
        str,
        Setting(
            "The cuboid's edges in mm, AxBxC.",
            label="Edges",
            note="AxBxC, mm",
            form=r"\d+(?:\.\d+)?(?:x\d+(?:\.\d+)?){2}",
            example="220x320x160",
        ),
    ]
    out: Report
    sensors: Sensors = None
    position: Annotated[
        list[str] | None, Setting("x,y,z of the cuboid's centre in mm, if it is known; once per sample.")
    ] = None
    thresholds: Thresholds = "5:100"
    unit: Unit = "mm"
    dataset: Dataset = EVERY_DATASET
    approach: Approach = None
    seed: Seed = 1


class ValidateObject(Command):
    """Of `validate object`."""

    model: Annotated[Path, Argument("The known object's mesh: PLY, OBJ or glTF.")]
    cloud: Annotated[Path, Argument("Reconstruction of the object: PLY, OBJ, glTF, or text with x y z.")]
    out: Report
    thresholds: Thresholds = "5:100"
    delta: Annotated[
        float | None,
        Setting("How far from the model points may lie during the search, mm; default: 2 % of its diagonal."),
    ] = None
    trim: Annotated[float, Setting("Share of the points, nearest first, that the refinement uses.")] = 0.8
    unit: Unit = "mm"
    model_unit: Annotated[
        str, replace(UNIT, help="Unit of the model: mm, cm, m or in.", label="Unit of the object", note="")
    ] = "mm"
    dataset: Dataset = EVERY_DATASET
    approach: Approach = None
    seed: Seed = 1


class ValidateViews(Command):
    """Of `validate views`."""

    run: Annotated[Path, Argument("Folder of a run.")]
    out: Report
    capture: Annotated[Path | None, Setting("Folder of the recording; default: where the run says it was.")] = None
    frames: Annotated[str | None, replace(FRAMES, help="A:B for the frames A to B-1; default: all of the run.")] = None
    models: Annotated[
        list[Path] | None,
        Setting("Folder of models of the scene by another program, with a scene.json; once for each."),
    ] = None
    threshold: Annotated[
        float | None,
        Setting(
            "Depths of two sensors agree within this, mm; default: the depth of one pixel of disparity.",
            label="Threshold",
            note="two sensors agree within this, mm; empty: the depth of one pixel of disparity",
            low=0.001,
            high=10_000,
        ),
    ] = None


class ValidateMesh(Command):
    """Of `validate mesh`."""

    mesh: Annotated[Path, Argument("Mesh or cloud: PLY, OBJ or glTF; mm.")]
    truth: Annotated[Path, Setting("True mesh or cloud, in the same coordinates: PLY, OBJ or glTF.")]
    out: Report
    thresholds: Annotated[str, Setting("Thresholds of the F-score, mm: FROM:TO or FROM:TO:STEP.")] = "1:20:1"
    threshold: Annotated[
        float | None, Setting("The threshold whose F-score counts as a measure; default: the middle one.")
    ] = None
    dataset: Dataset = EVERY_DATASET
    approach: Approach = None
    cell: Annotated[
        float | None, Setting("Compare means of points in cells of this size, mm, as Tanks and Temples does.")
    ] = None
    voxel: Annotated[float, Setting("Size of the voxels over which ETH3D averages, mm.")] = 10.0
    scanner: Annotated[
        str | None,
        Setting("x,y,z in mm from where the truth was scanned; ETH3D then counts what was visible from there."),
    ] = None
    seed: Seed = 1


class ValidateCloud(Command):
    """Of `validate cloud`."""

    clouds: Annotated[
        list[Path],
        Argument("For each approach a cloud or mesh (PLY, OBJ, glTF), or a folder of one for every frame; or a run."),
    ]
    reference: Annotated[
        Path, Setting("The reference (PLY, OBJ, glTF), or its folder of frames, such as CAPTURE/truth.")
    ]
    out: Report
    approach: Annotated[
        list[str] | None,
        Setting("Approach that a cloud belongs to, once for each in order; default: the cloud's name."),
    ] = None
    dataset: Annotated[str | None, Setting("Scene of a study that the clouds show; default: the run's, else all.")] = (
        None
    )
    frames: Annotated[
        str | None, replace(FRAMES, help="A:B for the frames A to B-1; default: all that are shared.")
    ] = None
    measures: Annotated[
        str | None,
        Setting("Only these: d1, d2, chamfer, f_score, colour, pointssim, or one of --methods; with commas."),
    ] = None
    peak: Annotated[
        float | None,
        Setting("Peak of the PSNR of D1 and D2; default: the largest distance of neighbours in the reference."),
    ] = None
    threshold: Annotated[
        float | None,
        Setting("Threshold of the F-score; default: a hundredth of the reference's longest side."),
    ] = None
    density: Annotated[
        float | None,
        Setting("Samples of meshes per squared unit; default: what puts 100 000 on the reference."),
    ] = None
    unit: Annotated[str, Setting("Unit of all clouds, for the tables; nothing is converted.")] = "mm"
    seed: Seed = 1
    methods: Annotated[Path | None, Setting("TOML file of measures by other programs, such as PCQM.")] = None


class ValidateFilms(Command):
    """Of `validate films`."""

    stimulus_set: Annotated[Path, Argument("Folder of the stimulus set, or its manifest.", metavar="SET")]
    reference: Annotated[
        str,
        Setting(
            "Condition that every other film of its scene is compared with, such as truth.",
            label="Reference",
            note="condition that the others are compared with",
            form=NAME,
            example="truth",
        ),
    ]
    out: Report
    masters: Annotated[
        bool,
        Setting("Measure the near-lossless masters, not the videos participants see.", flags=("--masters",)),
    ] = False
    every: Annotated[
        int,
        Setting(
            "Measure each such frame only, from the first on.",
            label="Every so many frames",
            note="is measured",
            high=1000,
        ),
    ] = Field(1, ge=1)
    workers: Workers = 1
