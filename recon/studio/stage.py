"""A scene made ready: every rest body triangulated once, then moved to any phase."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.geometry.rig import transformed
from recon.studio import objects
from recon.studio.actors.anatomy import person_parts
from recon.studio.actors.person import FOLD_SHADE, fold_depths, rest_body
from recon.studio.actors.skeleton import pose, rotation, skin, vertex_normals
from recon.studio.light.appearance import vertex_albedo
from recon.studio.light.looks import EYES_CLOSED, look_row
from recon.studio.light.shadow import key_share
from recon.studio.scenes import Actor, Moment, Prop, Scene


@dataclass(frozen=True, eq=False)
class Staged:
    """All bodies of a scene at one instant.

    Parameters
    ----------
    surface : float32 (N, 11), per vertex: place at rest, normal, place in the world, openness, share of the key light
    vertices : float64 (N, 3), mm, world
    looks : float64 (bodies, N_LOOK)
    """

    surface: NDArray[np.float32]
    vertices: NDArray[np.float64]
    looks: NDArray[np.float64]


class Stage:
    """The bodies of a scene, one after the other in shared arrays, and the key light on them.

    Attributes
    ----------
    faces : int32 (M, 3)
    owners : int64 (M,), the body of each face
    places : float64 (N, 3), mm, of the vertices at rest, where the colours are
    """

    def __init__(
        self, scene: Scene, *, cell: float, noise: NDArray[np.float32], towards_key: NDArray[np.float64]
    ) -> None:
        self._scene, self._towards_key, self._noise = scene, towards_key, noise
        self._people = [
            rest_body(person_parts(actor.build), look_row(actor.look), cell=cell, noise=noise) for actor in scene.actors
        ]
        self._things = [_prop_mesh(prop, cell) for prop in scene.props]
        looks = [actor.look for actor in scene.actors] + [prop.look for prop in scene.props]
        self._looks = np.stack([look_row(look) for look in looks])
        places = [body.places for body in self._people] + [vertices for vertices, _ in self._things]
        faces = [body.faces for body in self._people] + [faces for _, faces in self._things]
        starts = np.cumsum([0, *map(len, places)])
        self.places = np.concatenate(places)
        self._openness = np.concatenate(
            [*(body.openness for body in self._people), np.ones(sum(len(v) for v, _ in self._things))]
        )
        self.faces = np.concatenate([f + start for f, start in zip(faces, starts[:-1], strict=True)]).astype(np.int32)
        self.owners = np.repeat(np.arange(len(faces)), [len(f) for f in faces])
        body_of_vertex = np.repeat(np.arange(len(places)), [len(p) for p in places])
        self._albedo = vertex_albedo(self.places, body_of_vertex, self._looks, noise, cell)

    def at(self, phase: float) -> Staged:
        """Return the scene at a phase, 0 to 1."""
        moment = self._scene.moment(phase)
        transforms = [pose(controls) for controls in moment.controls]
        folds = [fold_depths(body, t) for body, t in zip(self._people, transforms, strict=True)]
        vertices = np.concatenate([*self._moved_people(transforms, folds), *self._moved_things(moment)])
        normals = vertex_normals(vertices, self.faces)
        surface = np.empty((len(vertices), 11), np.float32)
        surface[:, 0:3] = self.places
        surface[:, 3:6] = normals
        surface[:, 6:9] = vertices
        surface[:, 9] = self._openness
        n_cloth = sum(map(len, folds))
        depths = np.concatenate(folds) if folds else np.zeros(0, np.float32)
        surface[:n_cloth, 9] *= np.clip(1.0 + FOLD_SHADE * depths, 0.6, 1.1)
        surface[:, 10] = key_share(vertices, normals, self.faces, self._towards_key)
        looks = self._looks.copy()
        looks[: len(moment.blink), EYES_CLOSED] = moment.blink
        return Staged(surface, vertices, looks)

    def mesh(self, staged: Staged) -> Mesh:
        """Return the ground truth at an instant, coloured as under white light from everywhere."""
        colours = _display(self._albedo)
        return Mesh(staged.vertices.astype(np.float32), self.faces, staged.surface[:, 3:6].copy(), colours)

    def colours(
        self, staged: Staged, places: NDArray[np.float64], owners: NDArray[np.int64], footprint: float
    ) -> NDArray[np.uint8]:
        """Return the colours, uint8 (H, W, 3), of places (H, W, 3) on bodies (H, W) at rest, as under white light.

        Parameters
        ----------
        footprint : mm, features below this size are averaged away
        """
        albedo = vertex_albedo(places.reshape(-1, 3), owners.ravel(), staged.looks, self._noise, footprint)
        return _display(albedo).reshape(places.shape)

    def _moved_people(
        self, transforms: list[NDArray[np.float64]], folds: list[NDArray[np.float32]]
    ) -> list[NDArray[np.float64]]:
        return [
            _placed(actor, skin(body.vertices + depths[:, None] * body.normals, body.bones, body.weights, moved))
            for actor, body, moved, depths in zip(self._scene.actors, self._people, transforms, folds, strict=True)
        ]

    def _moved_things(self, moment: Moment) -> list[NDArray[np.float64]]:
        things = zip(self._things, moment.poses, strict=True)
        return [transformed(vertices, world) for (vertices, _), world in things]


def _display(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.asarray(np.rint(255 * np.clip(linear, 0, 1) ** (1 / 2.2)), np.uint8)


def _placed(actor: Actor, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(actor.scale * vertices @ rotation((0.0, actor.turn_deg, 0.0)).T + np.asarray(actor.place))


def _prop_mesh(prop: Prop, cell: float) -> objects.Mesh:
    if len(prop.size) == 1:
        return objects.ball(prop.size[0], min(cell, 0.036 * prop.size[0]))
    return objects.box((prop.size[0], prop.size[1], prop.size[2]), cell)
