"""Gaussian splats: what splatting methods train, and what this project films beside meshes and clouds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

N_HARMONICS = (1, 4, 9, 16)  # coefficients of a channel, by degree
UNIT_TOLERANCE = 1e-3
SIMILAR = 1e-3  # relative; how far a transform may be from a rotation with one scale


@dataclass(frozen=True, eq=False)
class Splats:
    """Ellipsoids of coloured, translucent density, drawn from behind each other over a picture.

    Convention: the standard deviations `scales` lie along the axes of the ellipsoid; `rotations` turn these axes into
    the world's. A colour is 0.5 plus the sum of the harmonics in the direction from the camera, in the basis and order
    of the original trainer, and it is what the screen shows (sRGB): neither light nor gamma is applied.

    Parameters
    ----------
    centres : float32 (N, 3)
    scales : float32 (N, 3), unit of the centres, at least 0
    rotations : float32 (N, 4), unit quaternions, w first
    opacities : float32 (N,), 0 to 1
    harmonics : float32 (N, 1, 4, 9 or 16, 3)
    antialiased : whether the method was trained with opacities that make up for the dilation, as Mip-Splatting
    model_from_world : float64 (3, 3), rotation of directions into the axes that the harmonics belong to
    unit : length of the file's unit in the world; nothing nearer to the camera than a hundredth of it is drawn

    Raises
    ------
    ValueError
        If the arrays differ in length, a number is not finite, a scale negative, an opacity beyond 0 to 1, or a
        quaternion not of unit length.

    Source: Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023.
    """

    centres: NDArray[np.float32]
    scales: NDArray[np.float32]
    rotations: NDArray[np.float32]
    opacities: NDArray[np.float32]
    harmonics: NDArray[np.float32]
    antialiased: bool = False
    model_from_world: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    unit: float = 1.0

    def __post_init__(self) -> None:
        n = len(self.centres)
        shapes = {"centres": (n, 3), "scales": (n, 3), "rotations": (n, 4), "opacities": (n,)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, _finite(getattr(self, name), name, shape))
        harmonics = np.asarray(self.harmonics)
        n_harmonics = harmonics.shape[1] if harmonics.ndim == 3 else 0
        if n_harmonics not in N_HARMONICS:
            raise ValueError(f"harmonics have shape {harmonics.shape}, expected (N, 1, 4, 9 or 16, 3)")
        object.__setattr__(self, "harmonics", _finite(harmonics, "harmonics", (n, n_harmonics, 3)))
        if (self.scales < 0).any():
            raise ValueError(f"scales go down to {self.scales.min():g}, expected none below 0")
        if n and not (self.opacities.min() >= 0 and self.opacities.max() <= 1):
            raise ValueError(f"opacities go from {self.opacities.min():g} to {self.opacities.max():g}, expected 0 to 1")
        lengths = np.linalg.norm(self.rotations, axis=1)
        if (np.abs(lengths - 1) > UNIT_TOLERANCE).any():
            raise ValueError("rotations hold quaternions that are not of unit length")

    def __len__(self) -> int:
        return len(self.centres)

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.integer]) -> Splats:
        """Choose splats by a mask (N,) or by indices (M,)."""
        names = ("centres", "scales", "rotations", "opacities", "harmonics")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def moved(self, transform: NDArray[np.floating]) -> Splats:
        """Move, turn and scale all splats.

        Parameters
        ----------
        transform : float64 (4, 4), a rotation with one scale and a translation

        Raises
        ------
        ValueError
            If it is anything else.
        """
        scale, rotation = rotation_and_scale(np.asarray(transform, np.float64))
        turn = quaternion(rotation)
        return replace(
            self,
            centres=(self.centres.astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]).astype(np.float32),
            scales=(self.scales * scale).astype(np.float32),
            rotations=_product(turn, self.rotations.astype(np.float64)).astype(np.float32),
            model_from_world=self.model_from_world @ rotation.T,
            unit=self.unit * scale,
        )


def rotation_and_scale(transform: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the scale and the rotation (3, 3) of a transform (4, 4), or raise a ValueError if it has other parts."""
    linear = transform[:3, :3]
    scale = float(np.cbrt(np.linalg.det(linear)))
    if not scale > 0 or np.abs(linear @ linear.T / scale**2 - np.eye(3)).max() > SIMILAR:
        raise ValueError(f"{linear.tolist()} is no rotation with one scale")
    return scale, linear / scale


def quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternion (4,), w first, of a rotation (3, 3)."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z])


def _product(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Multiply a quaternion (4,) with each of others (N, 4), and make the products of unit length."""
    a, b, c, d = first
    w, x, y, z = second.T
    product = np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
    return np.asarray(product / np.linalg.norm(product, axis=1, keepdims=True))


def _finite(values: NDArray[np.floating], name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    array = np.ascontiguousarray(values, dtype=np.float32)
    if array.shape != shape:
        raise ValueError(f"{name} have shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} hold values that are not finite numbers")
    return array
