"""The films of a stimulus set, each beside the reference's film of the same scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recon.pipeline.manifest import MANIFEST
from recon.render.encoding.video import VideoFacts, probe_video
from recon.runtime.files import read_json

FPS_TOLERANCE = 5e-4  # relative: 29.97 is 30000/1001, but 30 is not


@dataclass(frozen=True)
class Film:
    """A film of a stimulus set.

    Parameters
    ----------
    dataset, approach : the scene, and what is shown of it
    video : the file that is measured
    mask : video of the model's silhouette, white on black; None where there is none
    model_bytes : size of the model's files; None where the set does not say it
    """

    dataset: str
    approach: str
    video: Path
    mask: Path | None
    model_bytes: int | None = None

    @property
    def name(self) -> str:
        return f"{self.dataset}/{self.approach}"


@dataclass(frozen=True)
class Pair:
    """A film, and the reference's film of the same scene.

    Parameters
    ----------
    film, reference : alike in size, frame rate and number of frames
    facts : of both
    has_masks : whether all films of the scene have a mask, so that all are measured alike
    """

    film: Film
    reference: Film
    facts: VideoFacts
    has_masks: bool


def read_films(stimulus_set: Path, *, masters: bool) -> list[Film]:
    """List the films of a stimulus set.

    Parameters
    ----------
    stimulus_set : its folder or its manifest
    masters : whether to take the near-lossless masters instead of the videos that participants see

    Raises
    ------
    ValueError
        If there is no manifest, an entry of it is not as it must be, or a film has no master though one is asked for.
    """
    manifest = stimulus_set / MANIFEST if stimulus_set.is_dir() else stimulus_set
    entries = read_json(manifest).get("stimuli")
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{manifest}: stimuli is {entries!r:.80}, expected a list of videos as `render` writes it")
    films = [_film(manifest, number, entry, masters=masters) for number, entry in enumerate(entries)]
    names = [film.name for film in films]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{manifest}: lists {', '.join(twice)} more than once; keep one film of each")
    return films


def paired(films: Sequence[Film], reference: str) -> tuple[list[Pair], list[str]]:
    """Set each film beside the reference's film of its scene; also returns sentences on what is left out.

    Parameters
    ----------
    films : of a stimulus set
    reference : the approach, or other condition, that the others are compared with

    Raises
    ------
    ValueError
        If no scene has a film of the reference and another one, or two films of a scene are not alike.
    """
    by_dataset: dict[str, dict[str, Film]] = {}
    for film in films:
        by_dataset.setdefault(film.dataset, {})[film.approach] = film
    if not any(reference in conditions for conditions in by_dataset.values()):
        names = ", ".join(dict.fromkeys(film.approach for film in films))
        raise ValueError(f"no film is of the reference {reference!r}; the set's conditions are {names}")
    pairs: list[Pair] = []
    remarks = []
    for dataset, conditions in by_dataset.items():
        if reference not in conditions:
            remarks.append(
                f"{dataset}: has no film of the reference {reference}, only of {', '.join(conditions)}: not measured"
            )
        elif len(conditions) == 1:
            remarks.append(f"{dataset}: has no other film than the reference {reference}: not measured")
        else:
            pairs += _pairs(conditions, reference)
            if not pairs[-1].has_masks:
                without = ", ".join(film.name for film in conditions.values() if film.mask is None)
                remarks.append(
                    f"{dataset}: {without} have no mask of the model, so there are no measures of the actor alone, and "
                    "flicker is that of the whole frame; `render` writes masks"
                )
    if not pairs:
        raise ValueError(f"there is nothing to compare with {reference!r}: {'; '.join(remarks)}")
    return pairs, remarks


def _pairs(conditions: Mapping[str, Film], reference: str) -> Iterator[Pair]:
    facts = {film: probe_video(film.video) for film in conditions.values()}
    anchor = conditions[reference]
    has_masks = all(film.mask is not None for film in conditions.values())
    for film in conditions.values():
        _check_alike(film, facts[film], anchor, facts[anchor])
        if has_masks and film.mask is not None:
            _check_mask(film, film.mask, facts[film])
        if film is not anchor:
            yield Pair(film, anchor, facts[film], has_masks)


def _check_alike(film: Film, facts: VideoFacts, anchor: Film, expected: VideoFacts) -> None:
    same_rate = abs(facts.fps - expected.fps) <= FPS_TOLERANCE * expected.fps
    if (facts.width, facts.height, facts.n_frames) != (expected.width, expected.height, expected.n_frames) or not (
        same_rate
    ):
        raise ValueError(
            f"{film.video} is {_described(facts)}, but the reference {anchor.video} is {_described(expected)}; "
            "films are compared frame by frame: render or import both alike"
        )


def _check_mask(film: Film, mask: Path, facts: VideoFacts) -> None:
    mask_facts = probe_video(mask)
    if (mask_facts.width, mask_facts.height, mask_facts.n_frames) != (facts.width, facts.height, facts.n_frames):
        raise ValueError(
            f"the mask {mask} is {_described(mask_facts)}, but its film {film.video} is {_described(facts)}"
        )


def _described(facts: VideoFacts) -> str:
    return f"{facts.width}x{facts.height}, {facts.n_frames} frames at {facts.fps:g} a second"


def _film(manifest: Path, number: int, entry: Any, *, masters: bool) -> Film:
    where = f"{manifest}: stimuli[{number}]"
    if not isinstance(entry, dict):
        raise ValueError(f"{where} is {entry!r:.80}, expected an object with dataset, approach and video")
    dataset, approach, video = (_text(entry, key, where) for key in ("dataset", "approach", "video"))
    if masters and "master" not in entry:
        raise ValueError(f"{where}: {dataset}/{approach} has no master; measure the videos, or render with --master")
    chosen = _text(entry, "master", where) if masters else video
    mask = manifest.parent / _text(entry, "mask", where) if entry.get("mask") else None
    # A set whose masks were not copied along is measured without them.
    size = entry.get("model_bytes")
    return Film(
        dataset,
        approach,
        manifest.parent / chosen,
        mask if mask and mask.is_file() else None,
        size if isinstance(size, int) and size > 0 else None,
    )


def _text(entry: Mapping[str, Any], key: str, where: str) -> str:
    value = entry.get(key)
    if not isinstance(value, str) or not value:
        raise ValueError(f"{where}.{key} is {value!r:.80}, expected a text")
    return value
