"""Measures of films that know eyes and displays, by packages that are taken where they are installed.

FLIP compares two frames as somebody does who flips between them; ColorVideoVDP predicts from whole films by how much
people see one of them as worse, in JOD; LPIPS and DISTS compare what a network trained on photographs sees. No weights
are fetched: what a measure needs lies in its package, or in a file that the experimenter names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.video import read_video
from recon.validation.films.stimuli import Pair

PACKAGES = {  # module, and what to install
    "flip": ("flip_evaluator", "flip-evaluator"),
    "cvvdp": ("pycvvdp", "cvvdp"),
    "lpips": ("torchmetrics", "torchmetrics torchvision"),
    "dists": ("torchmetrics", "torchmetrics torchvision"),
}
NETWORKS = {  # measures that need weights: torchvision's name of the network, and its file
    "lpips": ("alexnet", "alexnet-owt-7be5be79.pth"),
    "dists": ("vgg16", "vgg16-397923af.pth"),
}
INCH_M = 0.0254


@dataclass(frozen=True)
class Display:
    """What the participants' films are shown on, in the words of a study's lab sheet.

    Parameters
    ----------
    size : (width, height), pixels
    size_inch : its diagonal
    distance_cm : from eyes to display
    peak_cd_m2 : luminance of its white
    """

    size: tuple[int, int] = (1920, 1080)
    size_inch: float = 24.0
    distance_cm: float = 60.0
    peak_cd_m2: float = 200.0

    @property
    def pixels_per_degree(self) -> float:
        """Pixels in a degree of visual angle, in the middle of the display."""
        pixel_m = self.size_inch * INCH_M / float(np.hypot(*self.size))
        return float(1 / np.rad2deg(np.arctan(pixel_m / (self.distance_cm / 100))))


def parse_display(text: str) -> Display:
    """Read "1920x1080,24,60,200": pixels, diagonal in inches, distance in cm, and peak luminance in cd/m2.

    A ValueError says what was expected.
    """
    try:
        size, *others = text.split(",")
        width, height = (int(side) for side in size.split("x"))
        inches, distance, peak = (float(other) for other in others)
    except ValueError as error:
        raise ValueError(
            f"the display is {text!r}, expected WIDTHxHEIGHT,INCHES,CM,CD/M2, for example 1920x1080,24,60,200"
        ) from error
    if min(width, height) < 1 or not all(0 < number < 1e5 for number in (inches, distance, peak)):
        raise ValueError(f"the display is {text!r}, expected numbers above 0")
    return Display((width, height), inches, distance, peak)


def parse_weights(texts: Sequence[str]) -> dict[str, Path]:
    """Read files of weights, each as MEASURE=FILE; a ValueError says which of them is not."""
    files = {}
    for text in texts:
        name, _, file = text.partition("=")
        if name not in NETWORKS or not Path(file).is_file():
            raise ValueError(f"the weights are {text!r}, expected {' or '.join(NETWORKS)}, = and a file that exists")
        files[name] = Path(file)
    return files


@dataclass(frozen=True)
class Perceptual:
    """What is measured by other packages, and how.

    Parameters
    ----------
    names : of the measures, in `PACKAGES`
    display : that the films are shown on
    weights : the file of the network's weights of each measure that needs one, as torchvision publishes them
    """

    names: tuple[str, ...] = ()
    display: Display = field(default_factory=Display)
    weights: Mapping[str, Path] = field(default_factory=dict)

    def check(self) -> None:
        """Raise a ValueError if there is no such measure, or if its package or weights are missing."""
        from importlib.util import find_spec

        for name in self.names:
            if name not in PACKAGES:
                raise ValueError(f"there is no measure {name!r}; expected one or more of {', '.join(PACKAGES)}")
            module, packages = PACKAGES[name]
            if find_spec(module) is None:
                raise ValueError(
                    f"{name} needs a package that is not installed: pip install 'reconstudy[perceptual]', or of that "
                    f"only {packages}"
                )
            if name in NETWORKS and name not in self.weights:
                network, file = NETWORKS[name]
                raise ValueError(
                    f"{name} needs the weights of {network}, which are not fetched; expected --weights {name}=FILE, as "
                    f"torchvision publishes it: https://download.pytorch.org/models/{file}"
                )

    def values(self, pair: Pair, name: str, *, every: int) -> list[float]:
        """Measure a film.

        Parameters
        ----------
        pair : the film and its reference
        name : of the measure
        every : measure each such frame only, from the first on; a measure of whole films takes all of them

        Returns
        -------
        a value for each measured frame; of a measure of whole films one for the first frame, and NaN for the others

        Raises
        ------
        ValueError
            If a file of weights holds others.
        """
        if name == "cvvdp":
            n_frames = len(range(0, pair.facts.n_frames, every))
            return [_colour_video_vdp(pair, self.display), *[np.nan] * (n_frames - 1)]
        if name == "flip":
            return list(_flip(pair, self.display, every))
        return list(_deep_features(pair, name, self.weights[name], every))


def _flip(pair: Pair, display: Display, every: int) -> Iterator[float]:
    """Yield the mean error of each frame, 0 to 1.

    Source: Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom, Fairchild, "FLIP: a difference evaluator for
    alternating images" (2020).
    """
    import flip_evaluator  # of the extra `perceptual`

    parameters = {"ppd": display.pixels_per_degree}
    for image, reference in _scaled_frames(pair, every):
        yield float(flip_evaluator.evaluate(reference, image, "LDR", applyMagma=False, parameters=parameters)[1])


def _deep_features(pair: Pair, name: str, weights: Path, every: int) -> Iterator[float]:
    """Yield LPIPS, of AlexNet, or DISTS of each frame; 0 for equal frames.

    Source: Zhang, Isola, Efros, Shechtman, Wang, "The unreasonable effectiveness of deep features as a perceptual
    metric" (2018); Ding, Ma, Wang, Simoncelli, "Image quality assessment: unifying structure and texture similarity"
    (2020).
    """
    import torch  # of the extra `perceptual`, as the others
    from torchmetrics.functional.image.dists import DISTSNetwork  # its metric would build it anew for each frame
    from torchmetrics.image import LearnedPerceptualImagePatchSimilarity

    with _only_weights(*NETWORKS[name], weights):
        metric = LearnedPerceptualImagePatchSimilarity("alex", normalize=True) if name == "lpips" else DISTSNetwork()
    with torch.no_grad():
        for frames in _scaled_frames(pair, every):
            yield float(metric(*(torch.from_numpy(frame).permute(2, 0, 1)[None] for frame in frames)))


@contextmanager
def _only_weights(network: str, name: str, file: Path) -> Iterator[None]:
    """Let torchvision find a file where it keeps what it fetched, and nothing else, so that it fetches nothing."""
    import torch

    before = torch.hub.get_dir()
    with TemporaryDirectory() as folder:
        (Path(folder) / "checkpoints").mkdir()
        (Path(folder) / "checkpoints" / name).symlink_to(file.resolve())
        torch.hub.set_dir(folder)
        try:
            yield
        except Exception as error:  # of many kinds, and many lines
            raise ValueError(f"{file}: holds no weights of {network}; expected torchvision's file {name}") from error
        finally:
            torch.hub.set_dir(before)


def _colour_video_vdp(pair: Pair, display: Display) -> float:
    """Return the quality in JOD; 10 is that of the reference itself.

    Source: Mantiuk, Hanji, Ashraf, Asano, Chapiro, "ColorVideoVDP: a visual difference predictor for image, video and
    display distortions" (2024).
    """
    import pycvvdp  # of the extra `perceptual`
    import torch
    from pycvvdp.video_source import video_source_dm

    photometry = pycvvdp.vvdp_display_photo_eotf(Y_peak=display.peak_cd_m2, contrast=1000, EOTF="sRGB")
    geometry = pycvvdp.vvdp_display_geometry(
        list(display.size), distance_m=display.distance_cm / 100, diagonal_size_inches=display.size_inch
    )
    frames = _frames(pair)

    class Source(video_source_dm):  # type: ignore[misc]  # the package has no types
        """Hands frames on one by one: a film of full HD would take gigabytes at once."""

        def __init__(self) -> None:
            super().__init__(display_photometry=photometry)
            self._at, self._shown = -1, (None, None)

        def get_video_size(self) -> tuple[int, int, int]:
            return pair.facts.height, pair.facts.width, pair.facts.n_frames

        def get_frames_per_second(self) -> float:
            return pair.facts.fps

        def get_batch_size(self) -> int:
            return 1

        def get_test_frame(self, frame: int, device: Any, colorspace: str) -> Any:
            return self._frame(0, frame, device, colorspace)

        def get_reference_frame(self, frame: int, device: Any, colorspace: str) -> Any:
            return self._frame(1, frame, device, colorspace)

        def _frame(self, place: int, frame: int, device: Any, colorspace: str) -> Any:
            while self._at < frame:
                self._shown, self._at = next(frames), self._at + 1  # type: ignore[assignment]  # none before the first
            assert self._at == frame, "the metric asks for frames in turn"
            pixels = torch.from_numpy(np.array(self._shown[place], np.float32)).to(device) / 255
            return self.apply_dm_and_color_transform(pixels.permute(2, 0, 1)[None, :, None], colorspace)

    metric = pycvvdp.cvvdp(display_photometry=photometry, display_geometry=geometry, heatmap=None, quiet=True)
    return float(metric.predict_video_source(Source())[0])


def _frames(pair: Pair) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    yield from zip(read_video(pair.film.video), read_video(pair.reference.video), strict=True)


def _scaled_frames(pair: Pair, every: int) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Yield each `every`-th frame of the film and of its reference, 0 to 1."""
    for number, frames in enumerate(_frames(pair)):
        if number % every == 0:
            image, reference = (np.asarray(each, np.float32) / np.float32(255) for each in frames)
            yield image, reference
