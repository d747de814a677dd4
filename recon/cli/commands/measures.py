"""The settings of the commands of objective evaluation."""

from __future__ import annotations

from pathlib import Path

from recon.cli.commands.setting import NAME, NAMES, OUT, Command, argument, option
from recon.cli.commands.shared import FRAMES, WORKERS

EVERY_DATASET = "all"
UNITS = {"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"}

REPORT = option(..., "Folder of the report.", flags=OUT)
DATASET = option(
    EVERY_DATASET,
    "Scene of a study that the results are for; all: every scene.",
    label="Dataset",
    form=NAME,
    example="ball",
    is_blank=True,
)
APPROACH = option(
    None,
    "Approach of a study that the results are for, such as pm_fb; may be repeated.",
    label="Approach",
    note="approach of a study that the results are for; empty: none",
    form=NAME,
    example="pm_fb",
)
SENSORS = option(
    None,
    "Sensor of each cloud, in order; fewer names than clouds repeat.",
    label="Sensors",
    flags=("--sensor",),
    form=NAMES,
    example="S1,S2",
)
THRESHOLDS = option(
    "5:100",
    "Thresholds of the inlier curve, mm: FROM:TO or FROM:TO:STEP.",
    label="Thresholds",
    form=r"\d+(?:\.\d+)?(?::\d+(?:\.\d+)?){1,2}",
    example="5:100",
    is_blank=True,
)
FILLED = option(True, "Count the surfaces that were filled where nothing was measured.", label="Count filled holes")
SEED = option(1, "Seed of the random samples; the same seed gives the same report.", ge=0)
UNIT = option("mm", "Unit of all files but glTF: mm, cm, m or in.", label="Unit", choices=UNITS)


class ValidateSphere(Command):
    """Of `validate sphere`."""

    clouds: list[Path] = argument("Models, or text with x y z; one file per sensor and placed ball.")
    radius: float = option(..., "Radius of the ball, mm.", label="Radius", low=0.001, high=1e6, gt=0)
    out: Path = REPORT
    sensors: list[str] | None = SENSORS
    method: str = option("robust", "How to find the sphere: robust or super4pcs.")
    thresholds: str = THRESHOLDS
    unit: str = UNIT
    viewpoint: list[str] | None = option(
        None, "[SENSOR=]x,y,z of a sensor, mm; then only points in front of or behind the ball count."
    )
    keep: list[str] | None = option(None, "SAMPLE/SENSOR to use although the rule excludes it.")
    drop: list[str] | None = option(None, "SAMPLE/SENSOR to leave out although the rule keeps it.")
    reference_centre: list[Path] | None = option(
        None,
        "Another instrument's scan of the ball, such as a LiDAR's, once per placed ball in order; or one text file "
        "with a centre x y z a line.",
    )
    reference_unit: str = option("mm", "Unit of the reference: mm, cm, m or in.")
    reference_frame: str = option(
        "own", "own: the reference has a frame of its own, which is estimated; sensors: the clouds'."
    )
    dataset: str = DATASET
    approach: list[str] | None = APPROACH
    seed: int = SEED


class ValidateCuboid(Command):
    """Of `validate cuboid`."""

    clouds: list[Path] = argument("Models, or text with x y z; one file per sensor and placed cuboid.")
    size: str = option(
        ...,
        "The cuboid's edges in mm, AxBxC.",
        label="Edges",
        form=r"\d+(?:\.\d+)?(?:x\d+(?:\.\d+)?){2}",
        example="220x320x160",
    )
    out: Path = REPORT
    sensors: list[str] | None = SENSORS
    position: list[str] | None = option(None, "x,y,z of the cuboid's centre in mm, if it is known; once per sample.")
    thresholds: str = THRESHOLDS
    unit: str = UNIT
    dataset: str = DATASET
    approach: list[str] | None = APPROACH
    seed: int = SEED


class ValidateObject(Command):
    """Of `validate object`."""

    model: Path = argument("The known object's mesh.")
    cloud: Path = argument("Reconstruction of the object: a model, or text with x y z.")
    out: Path = REPORT
    thresholds: str = THRESHOLDS
    delta: float | None = option(
        None, "How far from the model points may lie during the search, mm; default: 2 % of its diagonal.", gt=0
    )
    trim: float = option(0.8, "Share of the points, nearest first, that the refinement uses.", gt=0, le=1)
    unit: str = UNIT
    model_unit: str = option("mm", "Unit of the model: mm, cm, m or in.", label="Unit of the object", choices=UNITS)
    dataset: str = DATASET
    approach: list[str] | None = APPROACH
    seed: int = SEED


class ValidateViews(Command):
    """Of `validate views`."""

    run: Path = argument("Folder of a run.")
    out: Path = REPORT
    capture: Path | None = option(None, "Folder of the recording; default: where the run says it was.")
    frames: str | None = option(
        None, "How many, from the first on, or A:B for A to B-1; default: all of the run.", **FRAMES
    )
    models: list[Path] | None = option(
        None, "Folder of models of the scene by another program, with a scene.json; once for each."
    )
    threshold: float | None = option(
        None,
        "Depths of two sensors agree within this, mm; default: the depth of one pixel of disparity.",
        label="Threshold",
        low=0.001,
        high=10_000,
        gt=0,
    )
    filled: bool = FILLED


class ValidateMesh(Command):
    """Of `validate mesh`."""

    mesh: Path = argument("Mesh or cloud; mm.")
    truth: Path = option(..., "True mesh or cloud, in the same coordinates.")
    out: Path = REPORT
    thresholds: str = option("1:20:1", "Thresholds of the F-score, mm: FROM:TO or FROM:TO:STEP.")
    threshold: float | None = option(
        None, "The threshold whose F-score counts as a measure; default: the middle one.", gt=0
    )
    dataset: str = DATASET
    approach: list[str] | None = APPROACH
    cell: float | None = option(
        None, "Compare means of points in cells of this size, mm, as Tanks and Temples does.", gt=0
    )
    voxel: float = option(10.0, "Size of the voxels over which ETH3D averages, mm.", gt=0)
    scanner: str | None = option(
        None, "x,y,z in mm from where the truth was scanned; ETH3D then counts what was visible from there."
    )
    capture: Path | None = option(
        None, "Folder of the recording: completeness counts only what its sensors can see of the truth, a mesh."
    )
    filled: bool = FILLED
    seed: int = SEED


class ValidateCloud(Command):
    """Of `validate cloud`."""

    clouds: list[Path] = argument("For each approach a cloud or mesh, or a folder of one for every frame; or a run.")
    reference: Path = option(..., "The reference, or its folder of frames, such as CAPTURE/truth.")
    out: Path = REPORT
    approach: list[str] | None = option(
        None, "Approach that a cloud belongs to, once for each in order; default: the cloud's name."
    )
    dataset: str | None = option(None, "Scene of a study that the clouds show; default: the run's, else all.")
    frames: str | None = option(
        None, "How many, from the first on, or A:B for A to B-1; default: all that are shared.", **FRAMES
    )
    measures: str | None = option(
        None, "Only these: d1, d2, chamfer, f_score, colour, pointssim, or one of --methods; with commas."
    )
    peak: float | None = option(
        None, "Peak of the PSNR of D1 and D2; default: the largest distance of neighbours in the reference.", gt=0
    )
    threshold: float | None = option(
        None, "Threshold of the F-score; default: a hundredth of the reference's longest side.", gt=0
    )
    density: float | None = option(
        None, "Samples of meshes per squared unit; default: what puts 100 000 on the reference.", gt=0
    )
    unit: str = option("mm", "Unit of all clouds, for the tables; nothing is converted.")
    seed: int = SEED
    methods: Path | None = option(None, "TOML file of measures by other programs, such as PCQM.")


class ValidateFilms(Command):
    """Of `validate films`."""

    stimulus_set: Path = argument("Folder of the stimulus set, or its manifest.", metavar="SET")
    reference: str = option(
        ...,
        "Condition that every other film of its scene is compared with, such as truth.",
        label="Reference",
        form=NAME,
        example="truth",
    )
    out: Path = REPORT
    masters: bool = option(
        False, "Measure the near-lossless masters, not the videos participants see.", flags=("--masters",)
    )
    measure: str = option(
        "",
        "More measures, by packages that are installed beside (the extra perceptual): flip, cvvdp, lpips, dists; with "
        "commas.",
        label="More measures",
        form=NAMES,
        example="flip,cvvdp",
        is_blank=True,
    )
    display: str = option(
        "1920x1080,24,60,200",
        "What the films are shown on, for these: pixels, diagonal in inches, viewing distance in cm, peak luminance in "
        "cd/m2, as in a study's lab sheet.",
        metavar="WIDTHxHEIGHT,INCHES,CM,CD/M2",
    )
    weights: list[str] | None = option(
        None,
        "File of the weights of a network, as torchvision publishes them, once for each of lpips (AlexNet) and dists "
        "(VGG16); none is fetched.",
        metavar="MEASURE=FILE",
    )
    methods: Path | None = option(None, "TOML file of measures by other programs.")
    every: int = option(
        1, "Measure each such frame only, from the first on.", ge=1, label="Every so many frames", high=1000
    )
    workers: int = WORKERS
