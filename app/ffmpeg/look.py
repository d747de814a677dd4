"""Say how a film looks: pixel shape, rotation, colours, depth, interlacing and sound, as ffmpeg's log tells them.

The facts are those of decoded pictures (ffmpeg's filter `showinfo`), since what a container says of them may be wrong.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

UNTAGGED = "unknown"
HD_HEIGHT, HD_WIDTH = 720, 1280  # from which untagged colours are read as BT.709, as browsers do; below as BT.601
HDR_TRANSFERS = {"smpte2084": "PQ", "arib-std-b67": "HLG"}
SDR_TRANSFERS = (  # shown alike by browsers: as if all were sRGB
    UNTAGGED,
    "bt709",
    "smpte170m",
    "bt470bg",
    "bt470m",
    "gamma22",
    "gamma28",
    "smpte240m",
    "iec61966-2-1",
    "bt2020-10",
    "bt2020-12",
)
WITHOUT_RANGE = ("prores",)  # codecs in which no film says its range: the decoder names what is usual
DARKEST, BRIGHTEST = 10, 241  # of 8 bits: 6 beyond the limited range of luma, more than coding adds
LIMITED_UNTAGGED = ("h264", "hevc", "vp8", "vp9", "av1", "mpeg1video", "mpeg2video", "mpeg4")  # by their standards
SDR_NITS = 203  # of white among highlights: ITU-R BT.2408
USUAL_PEAK_NITS = 1000.0  # of films that do not say theirs

_STREAM = re.compile(r"^\[info\] +Stream #0:\d+\S*: (Video|Audio): (\w+)(.*)$", re.MULTILINE)
_ROTATION = re.compile(r"^\[info\] +Display Matrix: rotation of (-?[\d.]+) degrees", re.MULTILINE)
_HIDDEN_ALPHA = re.compile(r"^\[info\] +alpha_mode +: 1$", re.MULTILINE)  # VP8 and VP9: beside the pictures
_DOLBY = re.compile(r"^\[info\] +DOVI configuration record: .*profile: (\d+)", re.MULTILINE)
_PICTURE = re.compile(r"\[info\] n: *(\d+) .*? fmt:(\w+) .*?sar:(\d+)/(\d+) s:(\d+)x(\d+) i:(.)")
_COLOURS = re.compile(r"\[info\] color_range:(\S+) color_space:(\S+) color_primaries:(\S+) color_trc:(\S+)")
_LIGHT = re.compile(r"Content light level metadata: MaxCLL=(\d+)")
_MASTERED = re.compile(r"Mastering display metadata: .*max_luminance=([\d.]+)")
_BITS = re.compile(r"(?:p[024]?|y2|xv|gray|gbrap|x2rgb|x2bgr)(\d\d)(?:le|be)?$")  # yuv420p and rgb24 have 8
_OF_THREE = {30: 10, 36: 12, 48: 16}  # bits of a sample, where a format's name has those of a pixel: xv30
_PACKED = re.compile(r"(?:rgba?|bgra?|ya)(?:48|64|16)(?:le|be)$")
_ALPHA = re.compile(r"(?:yuva|gbrap|rgba|bgra|argb|abgr|ya\d)")


@dataclass(frozen=True)
class Look:
    """How a film's pictures are meant to be shown, as its pictures and its container say it.

    Parameters
    ----------
    codec : ffmpeg's name of it
    width, height : of the pictures after rotation, pixels
    pixel_format : ffmpeg's name of it
    pixel_shape : width of a pixel by its height, as displayed, after the rotation
    rotation : degrees by which the container wants the pictures turned, counterclockwise
    matrix, color_range, primaries, transfer : ffmpeg's names; "unknown": not tagged
    is_interlaced : does a picture hold two fields?
    has_sound : is there sound beside the pictures?
    n_films : tracks of pictures in the file, of which the first is taken
    peak_nits : of the brightest pixel of an HDR film, cd/m²
    hides_alpha : does transparency lie beside the pictures, where the decoder leaves it?
    dolby_profile : of Dolby Vision; 0: none
    beyond : share of luma darker than DARKEST or brighter than BRIGHTEST, where no range is tagged
    said_range : tv or pc, as the film's owner says where no range is tagged; empty: nothing is said
    """

    codec: str
    width: int
    height: int
    pixel_format: str
    pixel_shape: Fraction = Fraction(1)
    rotation: float = 0.0
    matrix: str = UNTAGGED
    color_range: str = UNTAGGED
    primaries: str = UNTAGGED
    transfer: str = UNTAGGED
    is_interlaced: bool = False
    has_sound: bool = False
    n_films: int = 1
    peak_nits: float = USUAL_PEAK_NITS
    dolby_profile: int = 0
    hides_alpha: bool = False
    beyond: float = 0.0
    said_range: str = ""

    @property
    def bits(self) -> int:
        """Bits of a sample."""
        if _PACKED.match(self.pixel_format):
            return 16
        depth = _BITS.search(self.pixel_format)
        return _OF_THREE.get(int(depth[1]), int(depth[1])) if depth else 8

    @property
    def is_rgb(self) -> bool:
        return self.pixel_format.startswith(("gbr", "rgb", "bgr", "0rgb", "0bgr", "argb", "abgr", "pal8"))

    @property
    def is_grey(self) -> bool:
        return self.pixel_format.startswith(("gray", "ya", "mono"))

    @property
    def has_alpha(self) -> bool:
        return self.hides_alpha or bool(_ALPHA.match(self.pixel_format))

    @property
    def hdr(self) -> str:
        """PQ or HLG; empty: not HDR."""
        return HDR_TRANSFERS.get(self.transfer, "")

    def shown_matrix(self, width: int, height: int) -> str:
        """Return the matrix by which the colours are read: by the tag, else as players do by the size."""
        if self.is_rgb:
            return "gbr"
        if self.matrix not in (UNTAGGED, "reserved", "gbr"):
            return self.matrix
        if self.primaries == "bt2020" or (self.hdr and self.primaries in (UNTAGGED, "reserved")):
            return "bt2020nc"
        return "bt709" if self.primaries == "bt709" or height >= HD_HEIGHT or width >= HD_WIDTH else "smpte170m"

    @property
    def shown_range(self) -> str:
        """Return the range by which values are read: tv or pc."""
        if self.color_range in ("tv", "pc"):
            return self.color_range
        return (self.said_range or "tv") if self.lacks_range else "pc"

    @property
    def lacks_range(self) -> bool:
        """Tell whether neither a tag nor the pixel format says the range."""
        is_told = self.is_rgb or self.is_grey or self.pixel_format.startswith("yuvj")
        return self.color_range not in ("tv", "pc") and not is_told

    def told(self, width: int, height: int) -> dict[str, Any]:
        """Return the facts as a manifest holds them."""
        return {
            "codec": self.codec,
            "pixel_shape": f"{self.pixel_shape.numerator}:{self.pixel_shape.denominator}",
            "rotation": self.rotation,
            "pixel_format": self.pixel_format,
            "bits": self.bits,
            "matrix": self.matrix,
            "range": self.color_range,
            "beyond_limited": round(self.beyond, 4),
            "primaries": self.primaries,
            "transfer": self.transfer,
            "read_as": {"matrix": self.shown_matrix(width, height), "range": self.shown_range},
            "interlaced": self.is_interlaced,
            "sound": self.has_sound,
        }


def parse_look(log: str) -> Look:
    """Return how a film looks by ffmpeg's log, which the filter `showinfo` wrote to.

    Raises
    ------
    ValueError
        If the log tells of no picture, or of pictures that change within the film.
    """
    header = log.partition("Stream mapping:")[0]
    streams = _STREAM.findall(header)
    films = [(codec, rest) for kind, codec, rest in streams if kind == "Video"]
    pictures, colours = _PICTURE.findall(log), _COLOURS.findall(log)
    if not films or not pictures:
        raise ValueError("holds no picture")
    _check_steady(pictures, colours)
    _, pixel_format, wide, high, width, height, _ = pictures[0]
    color_range, matrix, primaries, transfer = colours[0] if colours else (UNTAGGED,) * 4
    rotation, dolby = _ROTATION.search(header), _DOLBY.search(header)
    return Look(
        codec=films[0][0],
        width=int(width),
        height=int(height),
        pixel_format=pixel_format,
        pixel_shape=Fraction(int(wide), int(high)) if int(wide) and int(high) else Fraction(1),
        rotation=float(rotation[1]) if rotation else 0.0,
        matrix=matrix,
        color_range=UNTAGGED if films[0][0] in WITHOUT_RANGE else color_range,
        primaries=primaries,
        transfer=transfer,
        is_interlaced=any(picture[-1] in "TB" for picture in pictures),
        has_sound=any(kind == "Audio" for kind, *_ in streams),
        n_films=sum("attached pic" not in rest for _, rest in films),
        peak_nits=_peak(log),
        dolby_profile=int(dolby[1]) if dolby else 0,
        hides_alpha=bool(_HIDDEN_ALPHA.search(header)),
    )


def _check_steady(pictures: list[tuple[str, ...]], colours: list[tuple[str, ...]]) -> None:
    """Refuse pictures that change their size, their shape, their format or their colours."""
    for facts, what in (
        ([picture[1:6] for picture in pictures], "the size or the format of its pictures"),
        ([(*rest, "SDR" if trc in SDR_TRANSFERS else trc) for *rest, trc in colours], "the meaning of its colours"),
    ):
        changed = next((number for number, fact in enumerate(facts) if fact != facts[0]), None)
        if changed is not None:
            raise ValueError(f"changes {what} at picture {changed} (counted from 0), expected the same to the end")


def _peak(log: str) -> float:
    """Return the brightest pixel's cd/m²: as measured, else of the display that it was made on, else what is usual."""
    for pattern in (_LIGHT, _MASTERED):
        light = pattern.search(log)
        if light and float(light[1]) > SDR_NITS:
            return float(light[1])
    return USUAL_PEAK_NITS
