"""How large the experiment is, and what it takes in time and on the disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod

SCENES = ("ball", "box", "people", "standing", "face")  # figure 2
# On disk, for each pixel of a frame: the paper's six approaches, and one; measured on two people at 1080x1920.
SCENE_BYTES, OBJECT_BYTES = 60, 35
# On two idle cores, for each pixel of a frame, microseconds: 36 s of processor time for the models of two people at
# 1080x1920, and 10 s to record them; those of objects and films were measured before.
SCENE_US, OBJECT_US, FILM_US = 11.0, 7.6, 0.2
FILMS_OF_SCENE = 7  # of the paper's six approaches, and of the true models
FURTHER_S = 400.0  # for 1 650 votes, comparisons and starting everything, at any scale


@dataclass(frozen=True)
class Scale:
    """How large the experiment is.

    Parameters
    ----------
    size : (width, height) of the scenes' cameras, pixels; a standing person fills an upright picture
    object_size : of the cameras that record the sphere and the cuboid
    n_frames, fps : of each scene's recording
    n_spheres, n_cuboids : at how many places each is recorded
    video_size, video_fps, seconds : of the videos
    scenes : of the studio
    """

    size: tuple[int, int]
    object_size: tuple[int, int]
    n_frames: int
    fps: float
    n_spheres: int
    n_cuboids: int
    video_size: tuple[int, int]
    video_fps: float
    seconds: float
    scenes: tuple[str, ...] = SCENES

    @property
    def gigabytes(self) -> float:
        """What recordings and models take on the disk, about, by the paper's six approaches."""
        scenes, objects, _films = self._pixels
        return (scenes * SCENE_BYTES + objects * OBJECT_BYTES) / 1e9

    @property
    def hours(self) -> float:
        """How long all of it takes on two idle cores, about, by the paper's six approaches."""
        scenes, objects, films = self._pixels
        return ((scenes * SCENE_US + objects * OBJECT_US + films * FILM_US) / 1e6 + FURTHER_S) / 3600

    @property
    def _pixels(self) -> tuple[int, int, float]:
        """Count the pixels of one camera: of the scenes, of the objects, of all films with those of the truth."""
        scenes = len(self.scenes) * self.n_frames * prod(self.size)
        objects = (self.n_spheres + self.n_cuboids) * prod(self.object_size)
        films = len(self.scenes) * FILMS_OF_SCENE * self.video_fps * self.seconds * prod(self.video_size)
        return scenes, objects, films

    def resized(self, n_frames: int | None = None, seconds: float | None = None) -> Scale:
        """Record each scene in another number of frames of the same time, or make videos of another length."""
        frames = n_frames or self.n_frames
        fps = self.fps * frames / self.n_frames
        return replace(self, n_frames=frames, fps=fps, seconds=seconds or self.seconds)


SCALES = {
    "small": Scale((360, 640), (640, 640), 3, 5.0, 29, 3, (480, 270), 25.0, 3.0),
    "full": Scale((1080, 1920), (1440, 1440), 125, 25.0, 29, 12, (1920, 1080), 25.0, 15.0),
}
