"""From runs and models folders to a stimulus set: a video of every approach, and the manifest.

`render` goes on where an earlier start was stopped, as `reconstruct` does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

from recon.pipeline.film import PARTS, WHERE, Film, RenderOptions, make_film, make_part, make_path
from recon.pipeline.film_plan import check_loops, check_path_is_read_only, planned_films
from recon.pipeline.manifest import MANIFEST, Stimulus, write_manifest
from recon.pipeline.run import versions
from recon.pipeline.sources import Source, read_sources, scenes_apart
from recon.render.frames import choose_renderer
from recon.runtime.files import alone_in, remove_leftovers
from recon.runtime.remote import remove
from recon.runtime.workers import Pool, Progress, no_progress, open_pool


def render(
    folders: Sequence[Path],
    out: Path,
    options: RenderOptions,
    progress: Progress = no_progress,
    *,
    practice: str = "",
) -> Path:
    """Make a video of every approach of every run and models folder, and the manifest; returns the manifest's path.

    Path, light, background, renderer and encoder settings are the same for all approaches of a scene. The path is
    written beside the videos, as ``paths/DATASET.json``.

    Parameters
    ----------
    folders, out : runs and models folders, and the folder of the stimulus set
    options : how to show the models
    progress : told after each model that is checked, and after each part of a video, in frames
    practice : the scene whose two videos are for practice only; empty: none

    Raises
    ------
    ValueError
        If a folder is neither a run nor a models folder, a model cannot be filmed, two folders have a film in common or
        would take different paths around one scene, a file of cameras does not fit, the practice does not have two
        videos beside others, or another start is writing into the folder. Nothing is written then.
    """
    out = out.resolve()
    folders = [folder.resolve() for folder in folders]
    if out in folders:
        raise ValueError(f"{out}: is one of the folders that are filmed; choose another one for the stimulus set")
    options = replace(options, renderer=choose_renderer(options.renderer))
    sources = read_sources(folders)
    check_loops(sources, options)
    check_path_is_read_only(sources, options, out)
    _check_practice(practice, [source.dataset for source in sources for _ in source.sequences])
    with open_pool(options.workers, options.cluster) as pool:
        films, warnings = planned_films(sources, options, pool, progress)
        with alone_in(out):
            paths = {film.dataset: make_path(film, out) for film in {film.dataset: film for film in films}.values()}
            stimuli = _make_films(films, out, pool, progress)
            floors = {film.dataset: film.floor_y for film in films}
            told = {"paths": paths, "floors": floors, "warnings": [*warnings, *scenes_apart(sources, practice)]}
            provenance = _provenance(sources, films, options) | told
            return write_manifest(out, out.name, stimuli, provenance, practice=practice)


def _make_films(films: Sequence[Film], out: Path, pool: Pool, progress: Progress) -> list[Stimulus]:
    """Make the films that are not finished, and return the stimuli of all."""
    remove_leftovers(out)
    unfinished = [film for film in films if not film.is_finished(out)]
    if unfinished:
        remove(out / MANIFEST)  # it describes the films of an earlier start, which this one may replace
    parts = [partial(make_part, film, out, part, threads=pool.threads) for film in unfinished for part in film.parts]
    _run_parts(parts, pool, progress)
    stimuli = list(pool.run([partial(make_film, film, out) for film in films]))
    stimuli.sort(key=lambda stimulus: (stimulus.dataset, stimulus.approach))
    remove_leftovers(out)  # of workers that were lost
    remove(out / PARTS)
    return stimuli


def _provenance(sources: Sequence[Source], films: Sequence[Film], options: RenderOptions) -> dict[str, Any]:
    """Describe what the films are made of, for the manifest."""
    path = options.path.name if isinstance(options.path, Path) else options.path
    return {
        "runs": [source.provenance for source in sources if source.is_run],
        "models": [source.provenance | _digests(source, films) for source in sources if not source.is_run],
        "render": {name: value for name, value in asdict(options).items() if name not in WHERE} | {"path": path},
        "versions": versions(),
    }


def _check_practice(practice: str, datasets: Sequence[str]) -> None:
    """Raise a ValueError if the practice does not fit; `datasets` holds the scene of every film."""
    if not practice:
        return
    n_practised = datasets.count(practice)
    n_compared = len(datasets) - n_practised
    if n_practised != 2 or n_compared == 0:
        raise ValueError(
            f"the practice {practice!r} has {n_practised} videos, and other scenes have {n_compared}; expected a scene "
            f"with two, one plainly better, beside those that are compared: {', '.join(sorted(set(datasets)))}"
        )


def _digests(source: Source, films: Sequence[Film]) -> dict[str, Any]:
    """Return the digests of a models folder's models by approach and file, for the manifest."""
    names = {item.approach for item in source.sequences}
    shown = [film.sequence for film in films if film.dataset == source.dataset and film.sequence.approach in names]
    return {
        "sha256": {
            item.approach: {file.name: digest for file, digest in zip(item.files, item.digests, strict=True)}
            for item in shown
        }
    }


def _run_parts(parts: Sequence[partial[tuple[int, int]]], pool: Pool, progress: Progress) -> None:
    """Make the parts of videos; progress counts the frames that are made, as of the files of a run."""
    done, total = 0, sum(len(part.args[2]) for part in parts)
    progress("video frames", done, total)
    for n_made, n_known in pool.run(parts):
        done, total = done + n_made, total - n_known
        progress("video frames", done, total)
