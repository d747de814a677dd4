"""Turn a film's colours into those that every browser shows alike: BT.709 in 8 bits, by ffmpeg's filters.

zscale (zimg) reckons in floating point and rounds once; swscale's default turns greys green by a few levels.
"""

from __future__ import annotations

from app.ffmpeg.look import SDR_NITS, SDR_TRANSFERS, UNTAGGED, Look

TONE_MAPPING = f"the Möbius curve (ffmpeg's tonemap=mobius), with white at {SDR_NITS} cd/m² (ITU-R BT.2408)"
BT709 = "setparams=range=tv:color_primaries=bt709:color_trc=bt709:colorspace=bt709"
_MATRICES = ("bt709", "smpte170m", "bt470bg", "smpte240m", "fcc", "bt2020nc", "bt2020c", "ycgco", "gbr")
_NAMES = {  # zscale's, where they are others than those that ffmpeg's log has
    "bt2020nc": "2020_ncl",
    "bt2020c": "2020_cl",
    "tv": "limited",
    "pc": "full",
}
_PRIMARIES = (
    "bt709",
    "bt470m",
    "bt470bg",
    "smpte170m",
    "smpte240m",
    "film",
    "bt2020",
    "smpte431",
    "smpte432",
    "ebu3213",
)


def unknown_colours(look: Look, width: int, height: int) -> str:
    """Return what of a film's colours cannot be read; empty: all can."""
    if look.dolby_profile in (4, 5):
        return f"Dolby Vision, profile {look.dolby_profile}, whose colours only its own players can read"
    if (matrix := look.shown_matrix(width, height)) not in _MATRICES:
        return f"the matrix {matrix}"
    if look.primaries not in (UNTAGGED, "reserved", *_PRIMARIES):
        return f"the primaries {look.primaries}"
    if look.transfer not in (*SDR_TRANSFERS, "reserved") and not look.hdr:
        return f"the transfer {look.transfer}"
    return ""


def browser_colours(look: Look, width: int, height: int) -> str:
    """Return the filter that makes BT.709, limited range, of a film; for HDR tone-mapped to what a usual display shows.

    Browsers show all transfers of SDR as if they were the display's own, so these are kept, and only named anew.

    Parameters
    ----------
    look : of a film whose colours can be read
    width, height : pixels; from HD on untagged colours are BT.709
    """
    source = _source(look, width, height)
    if not look.hdr:
        return f"zscale={source}:tin=bt709:m=bt709:r=limited:p=bt709:t=bt709:f=bicubic,{BT709}"
    peak = look.peak_nits / SDR_NITS
    return (
        f"zscale={source}:tin={look.transfer}:t=linear:p=bt709:npl={SDR_NITS}:f=bicubic,format=gbrpf32le,"
        f"tonemap=mobius:desat=0:peak={peak:.6g},zscale=t=bt709:m=bt709:r=limited,{BT709}"
    )


def _source(look: Look, width: int, height: int) -> str:
    matrix, primaries = look.shown_matrix(width, height), look.primaries
    if primaries in (UNTAGGED, "reserved"):
        primaries = "bt2020" if look.hdr or matrix.startswith("bt2020") else "bt709"
    facts = {"min": matrix, "rin": look.shown_range, "pin": primaries}
    return ":".join(f"{key}={_NAMES.get(value, value)}" for key, value in facts.items())
