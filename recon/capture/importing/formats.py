"""The formats that `capture import` takes: by which files each is known, and what reads it.

The words of each for people stand in `recon.cli.commands.recordings`, which must not load what reads.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path

import cv2

from recon.capture.format import CAPTURE_FILE, Capture, CaptureError
from recon.capture.images import PICTURE_SUFFIXES, VIDEO_SUFFIXES
from recon.capture.importing.calibrations.benchmarks import read_kitti, read_middlebury_pair
from recon.capture.importing.calibrations.matlab import SAYS as MATLAB_SAYS
from recon.capture.importing.calibrations.matlab import read_matlab
from recon.capture.importing.calibrations.multi_view import MIV_SAYS, read_miv, read_mvsnet, read_strecha
from recon.capture.importing.calibrations.placed import Placed, beginning
from recon.capture.importing.calibrations.robots import read_euroc, read_kalibr, read_ros
from recon.capture.importing.calibrations.stereo_entry import KEYS
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.colmap_model import FOLDERS
from recon.capture.importing.depth_cameras.bags import import_bag
from recon.capture.importing.depth_cameras.kinect import import_kinect
from recon.capture.importing.depth_cameras.sequences import read_scannet, read_tum
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.json_file import SAYS as JSON_SAYS
from recon.capture.importing.json_file import import_json
from recon.capture.importing.meshroom import SFM_FILES, import_meshroom
from recon.capture.importing.middlebury import FPS, TEMPLE_PAIRS, import_middlebury
from recon.capture.importing.nerfstudio import TRANSFORMS, import_nerfstudio
from recon.capture.importing.opencv import import_opencv
from recon.capture.importing.sources import ImportOptions, Recording
from recon.capture.importing.views import choose_sensors
from recon.runtime.files import any_case, check_exists, files_like
from recon.runtime.notices import Notice

AUTO = "auto"
BROKEN = (AttributeError, LookupError, OverflowError, TypeError, cv2.error)  # what reading raises of odd values
ALIKE = 0.7  # of two names, from 0 to 1
MM, METRE = 1.0, 1000.0
TEMPLE_FRAMES = 3
PLACED = ("pairs", "units", "up")  # options of most formats


ELSEWHERE = {  # of what is not read, by its name and the beginning of a table or XML after it; and the way out
    r"^[^\n]*\.(zip|tar|gz|tgz|bz2|xz|7z|rar)\n": "is an archive; unpack it, and name the folder",
    r"^[^\n]*\.(psx|psz)\n|<document version=[^>]*>\s*<chunk": "is Metashape's; export its cameras in COLMAP's format, "
    "with the undistorted pictures",
    r"^(bundle.*\.out|[^\n]*\.nvm|sfm_data\.(json|bin)|[^\n]*\.rcproj|reconstruction\.json)\n|<BlocksExchange|\n#name,x,y,"
    r"|^[^\n]*_calibrated_camera_parameters\.txt\n": "is of a program whose cameras are not read; export them in "
    "COLMAP's format",
    r"^[^\n]*\.svo2?\n": "is Stereolabs' own recording; export its rectified pictures, and their calibration as `json`",
    r"^[^\n]*\.(npz|npy|pkl)\n": "is Python's own; write the matrices as `opencv` with cv2.FileStorage",
}
TOLD_INSIDE = (".xml", ".csv")  # endings of many programs' files, which their content tells apart


@dataclass(frozen=True)
class Format:
    """A format of recordings.

    Parameters
    ----------
    run : imports from a source into a folder
    files : patterns of the files it is known by, below the source
    holds : regular expression of what such a file says; empty: anything
    means : unit, conventions, and what else comes in: for the manual
    takes : options that not all formats take
    """

    run: Callable[[Path, Path, ImportOptions], Capture]
    files: tuple[str, ...]
    means: str
    holds: str = ""
    takes: tuple[str, ...] = PLACED

    def files_in(self, source: Path) -> list[Path]:
        """Return the files of a source that it is known by; none: it is of another format."""
        return [path for path in self.candidates(source) if re.search(self.holds, beginning(path))]

    def candidates(self, source: Path) -> Iterator[Path]:
        """Yield the files of a source that have the names of this format's, whatever they say."""
        for pattern in self.files:
            if source.is_dir():
                yield from files_like(source, pattern)
            elif source.is_file() and source.match(any_case(Path(pattern).name)):
                yield source


def import_recording(name: str, source: Path, out: Path, options: ImportOptions) -> Capture:
    """Import a recording by the reader of its format.

    Parameters
    ----------
    name : of the format, a key of FORMATS, or AUTO to find it
    source : file or folder
    out : the capture's folder, absent or empty
    options : what the importing person said

    Raises
    ------
    CaptureError
        Naming what is wrong, and the format that the source looks like, if it is another one.
    """
    name = find_format(source) if name == AUTO else name
    try:
        check_exists(source)
        return FORMATS[name].run(source, out, options)
    except BROKEN as error:
        raise CaptureError(f"{source}: is not whole: {type(error).__name__} {error}") from error
    except ValueError as error:
        likely = [] if FORMATS[name].files_in(source) else list(_known(source))
        if isinstance(error, CaptureError) and not likely:
            raise
        place = "" if str(source) in str(error) else f"{source}: "
        looks = f"; the source looks like {' or '.join(likely)}" if likely else ""
        raise CaptureError(f"{place}{error}{looks}") from error


def find_format(source: Path) -> str:
    """Return the name of a source's format, or raise a ValueError that names the nearest one.

    Where other files make it one of another format too, a Notice says which was taken.
    """
    check_exists(source)
    if (source / CAPTURE_FILE).is_file():
        raise CaptureError(f"{source}: is a capture already, with a {CAPTURE_FILE}; nothing is to be imported")
    if known := _known(source):
        name, files = next(iter(known.items()))
        others = [f"{other} ({paths[0].name})" for other, paths in known.items() if not {*paths} <= {*files}]
        if others:
            warnings.warn(
                f"{source}: is read as {name} ({files[0].name}); it may be {' or '.join(others)} as well: name the "
                f"format in place of {AUTO} to choose",
                Notice,
                stacklevel=2,
            )
        return name
    raise CaptureError(f"{source}: is in no format that is known{_nearest(source)}. Known are {', '.join(FORMATS)}")


def _nearest(source: Path) -> str:
    """Say which format has such names and other content, what other program a file is of, or which names are alike."""
    for name, kind in FORMATS.items():
        by_name = [
            path for path in kind.candidates(source) if f"*{path.suffix.lower()}" not in kind.files
        ]  # any name says nothing
        if by_name:
            return f"; nearest is {name}, but {by_name[0].name} is none of its files: {kind.means}"
    paths = sorted(source.iterdir()) if source.is_dir() else [source]
    names = [path.name for path in paths]
    for form, words in ELSEWHERE.items():
        if others := [path.name for path in paths if re.search(form, _told(path), re.IGNORECASE)]:
            return f", but {others[0]} {words}"
    pairs = [
        (
            max((_likeness(Path(file).name, name) for name in names), default=0.0),
            place if file.startswith("*") else -place,  # of any name, that which most programs can write stands last
            format_name,
            file,
        )
        for place, (format_name, kind) in enumerate(FORMATS.items())
        for file in kind.files
    ]
    likeness, _, nearest, file = max(pairs)
    if likeness < ALIKE:
        is_recorded = any(Path(name).suffix.lower() in (*PICTURE_SUFFIXES, *VIDEO_SUFFIXES) for name in names)
        calibrate = "; `reconstudy capture calibrate` measures them from pictures of a board" if is_recorded else ""
        return f", as none of its files tells cameras{calibrate}"
    return f"; nearest is {nearest}, which has {file}: {FORMATS[nearest].means}"


def _told(path: Path) -> str:
    """Return a file's name, and the beginning of one whose name says little, below."""
    is_read = path.suffix.lower() in TOLD_INSIDE and path.is_file()
    return f"{path.name}\n{beginning(path) if is_read else ''}"


def _known(source: Path) -> dict[str, list[Path]]:
    """Return the files that a source is known by, by the format."""
    return {name: files for name, kind in FORMATS.items() if (files := kind.files_in(source))}


def _likeness(pattern: str, name: str) -> float:
    return SequenceMatcher(None, pattern.replace("*", "").lower(), name.lower()).ratio()


def _placed(read: Callable[[Path, float], Placed], unit_mm: float) -> Callable[[Path, Path, ImportOptions], Capture]:
    """Return an importer of a calibration's views: pairs as they are said, or neighbours where these are a rig."""

    def run(source: Path, out: Path, options: ImportOptions) -> Capture:
        placed = read(source, options.unit_mm or unit_mm)
        if not placed.views:
            raise CaptureError(f"{source}: no camera of it has pictures")
        recording = choose_sensors(source, placed.views, options.pairs or placed.pairs, placed.bounds, placed.up)
        return write_recording(out, replace(recording, fps=placed.fps), options)

    return run


def _asking(read: Callable[[Path, float | None], Placed]) -> Callable[[Path, Path, ImportOptions], Capture]:
    """Return such an importer of files that may tell their unit themselves."""

    def run(source: Path, out: Path, options: ImportOptions) -> Capture:
        return _placed(lambda path, _: read(path, options.unit_mm), MM)(source, out, options)

    return run


def _recorded(read: Callable[[Path, ImportOptions], Recording]) -> Callable[[Path, Path, ImportOptions], Capture]:
    """Return an importer of what depth cameras recorded."""
    return lambda source, out, options: write_recording(out, read(source, options), options)


def _temple(source: Path, out: Path, options: ImportOptions) -> Capture:
    return import_middlebury(
        source,
        out,
        pairs=options.pairs or TEMPLE_PAIRS,
        n_frames=options.n_frames or TEMPLE_FRAMES,
        bounds=options.bounds,
        name=options.name,
        fps=options.fps or FPS,
    )


def _eth3d(source: Path, out: Path, options: ImportOptions) -> Capture:
    return import_colmap(source, out, options.pairs, replace(options, unit_mm=options.unit_mm or METRE))


FORMATS: dict[str, Format] = {  # the first of those that know a source reads it
    "middlebury": Format(
        _temple,
        ("*_par.txt",),
        "P = K [R t], metres, y up, 3 frames; the bounds stand in its README",
        takes=("pairs",),
    ),
    "middlebury-pair": Format(
        _placed(read_middlebury_pair, MM),
        ("calib.txt",),
        "`im0.png`, `im1.png`, mm; true disparities `disp0.pfm` or `disp0GT.pfm` become depth maps of the left camera",
        r"cam0\s*=\s*\[",
    ),
    "kitti": Format(
        _placed(read_kitti, METRE),
        ("calib_cam_to_cam.txt", "calib.txt", "../calib_cam_to_cam.txt", "*.txt"),
        "metres; raw recordings before or after rectification by the size of their pictures, odometry, or the file of "
        "one pair of the stereo benchmarks with its `disp_occ_0`",
        r"(?m)^P(0|2|_rect_0[0-3]):\s",
    ),
    "euroc": Format(
        _placed(read_euroc, METRE),
        ("mav0/cam0/sensor.yaml", "cam0/sensor.yaml"),
        "`T_BS`, metres, pictures in `cam0/data`",
        r"(?m)^T_BS:",
    ),
    "kalibr": Format(
        _placed(read_kalibr, METRE),
        ("*camchain*.yaml", "*.yaml"),
        "`T_cn_cnm1`, metres, pictures in `cam0`, `cam1`, ...",
        r"(?m)^cam0:",
    ),
    "ros": Format(
        _placed(read_ros, METRE),
        ("*.yaml", "*.yml"),
        "two files of camera_info, metres: which is the left one, P says; pictures in folders of their names",
        r"(?m)^(projection_matrix:|(K|k): ?\[|(P|p): ?\[|(K|k):\s*\n- )",
    ),
    "eth3d": Format(
        _eth3d,
        ("dslr_calibration_undistorted/cameras.txt", "rig_calibration_undistorted/cameras.txt"),
        "as `colmap`, metres; the undistorted set",
    ),
    "colmap": Format(
        lambda source, out, options: import_colmap(source, out, options.pairs, options),
        tuple((Path(folder) / f"cameras{suffix}").as_posix() for suffix in (".bin", ".txt") for folder in FOLDERS),
        "pairs are IMAGE_IDs, any unit; `images/`, and `masks/NAME.png`, black off the object; bounds from the points",
    ),
    "nerfstudio": Format(
        lambda source, out, options: import_nerfstudio(source, out, options.pairs, options),
        (TRANSFORMS,),
        "pairs count `frames` from 1, any unit, z up; `applied_transform` and `applied_scale` are undone; `mask_path`; "
        "views with `depth_file_path` become sensors, `test_filenames` are held out",
        r'"frames"|"camera_angle_x"|"fl_x"',
    ),
    "meshroom": Format(
        lambda source, out, options: import_meshroom(source, out, options.pairs, options),
        (*SFM_FILES, "*.sfm"),
        "pairs are viewIds, any unit; AliceVision's versions 1.0 to 1.2.x; for Alembic, add the node ConvertSfMFormat",
        r'"intrinsics"',
    ),
    "matlab": Format(
        _asking(read_matlab),
        ("*.mat", "*.json"),
        "`s = toStruct(stereoParams); save('stereo.mat', '-struct', 's', '-v7')`, or `jsonencode(s)`; or "
        "`stereoParametersToOpenCV`'s variables, or `Calib_Results_stereo.mat`; pictures in `left`, `right`",
        MATLAB_SAYS,
        ("units", "up"),
    ),
    "miv": Format(
        _asking(read_miv),
        ("*.json",),
        "metres, z up, perspective; a folder or video of each camera's name; bounds from `Depth_range`",
        MIV_SAYS,
    ),
    "strecha": Format(
        _placed(read_strecha, METRE),
        ("*.camera", "cameras/*.camera"),
        "x = K [R^T, -R^T t], metres; pairs count from 0",
    ),
    "mvsnet": Format(
        _asking(read_mvsnet),
        ("cams/*_cam.txt", "*_cam.txt"),
        "any unit (mm of DTU), `images/`; `rendered_depth_maps/*.pfm`; bounds from the depths",
        r"^\s*extrinsic",
    ),
    "tum": Format(
        _recorded(read_tum),
        ("rgb.txt", "depth.txt"),
        "`rgb.txt`, `depth.txt`; with `groundtruth.txt`, `--shots` or eight frames become sensors and others between "
        "them are held out; without, the camera stood still; the camera by the sequence's name, or `calibration.txt`",
        r"(?m)^\d+\.?\d*\s+\S+\.\w+\s*$",
        ("units", "up", "shots"),
    ),
    "scannet": Format(
        _recorded(read_scannet),
        ("intrinsic/intrinsic_color.txt", "intrinsics_color.txt", "intrinsics.txt", "intrinsic.txt"),
        "`color`, `depth` in mm, `pose` (or none), `intrinsic`; as `tum`",
        takes=("units", "up", "shots"),
    ),
    "rosbag": Format(
        import_bag,
        ("*.bag", "metadata.yaml", "*.db3", "*.mcap"),
        "ROS 1 and 2, RealSense's viewer: two topics with camera_info, a pair or pictures and depth maps (of ROS "
        "aligned to them); `--shots TOPIC,TOPIC` where there are more; `pip install 'reconstudy[ros]'`",
        r"^#ROSBAG V2|rosbag2_bagfile_information|^SQLite format 3|MCAP0",
        ("units", "up", "shots"),
    ),
    "kinect": Format(
        import_kinect,
        ("*.mkv",),
        "Azure Kinect's and Femto's recorder: tracks COLOR and DEPTH, which is brought into the pictures, and the "
        "calibration attached",
        r"CalibrationInformation|K4A_|DEPTH",
        ("units", "up"),
    ),
    "opencv": Format(
        lambda source, out, options: import_opencv(source, out, options),
        ("*.yml", "*.yaml", "*.xml"),
        "as `cv2.stereoCalibrate`, mm: `K1 D1 K2 D2 R T` (or `M1`, `cameraMatrix1`, ...), in one file or two; several "
        "`sensors`, each with `id` and `cam_from_world`; `left`, `right`, or `S1/left` and so on; `held_out`",
        rf"^%YAML|opencv_storage|opencv-matrix|(?im:(?:^|[{{, ])({KEYS['K1'].pattern}):)",
        ("units", "up"),
    ),
    "json": Format(
        lambda source, out, options: import_json(source, out, options, shots=options.shots),
        ("*.json",),
        "[for everything else](capture.md#the-json), also `held_out`",
        JSON_SAYS,
        ("units", "up", "shots"),
    ),
}
