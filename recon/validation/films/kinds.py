"""The measures of films: their titles, their units, and which way is better."""

from __future__ import annotations

from dataclasses import dataclass

from recon.validation.measures import LESS, MORE

ACTOR = "_actor"  # ends the names of measures inside the silhouettes


@dataclass(frozen=True)
class Kind:
    """What a measure is.

    Parameters
    ----------
    title : for tables and figures
    direction : `MORE` or `LESS` is better
    unit : "" for none
    is_of_film : whether a film has one value, instead of one for each frame
    """

    title: str
    direction: str = MORE
    unit: str = ""
    is_of_film: bool = False

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title


KINDS = {  # in the order of tables and figures
    "psnr_y": Kind("PSNR-Y", unit="dB"),
    "ssim": Kind("SSIM"),
    "ms_ssim": Kind("MS-SSIM"),
    "vmaf": Kind("VMAF"),
    "flicker": Kind("flicker", LESS, "grey levels"),
    "flip": Kind("FLIP", LESS),
    "cvvdp": Kind("ColorVideoVDP", unit="JOD", is_of_film=True),
    "lpips": Kind("LPIPS", LESS),
    "dists": Kind("DISTS", LESS),
}
