"""Which files of a models folder are whose: `APPROACH/FRAME.ply`, or `APPROACH.ply` of a model that does not move."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

from recon.models.read import MODEL_SUFFIXES
from recon.runtime.files import check_safe_name

NUMBERED = re.compile(r"(.*?)(\d+)")  # of a frame: any letters, then its number
BESIDE = {".mtl", ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".bin", ".txt", ".md", ".json"}
SOG = "meta.json"  # of splats, beside pictures of their properties
FORMATS = ", ".join(MODEL_SUFFIXES)
MOST_NAMED = 5  # of missing frames


SafeName = Annotated[str, AfterValidator(check_safe_name)]


def find_models(folder: Path) -> tuple[dict[str, tuple[Path, ...]], list[str]]:
    """Find the models of every approach in the order of their numbers; returns them, and a sentence for each fault."""
    models: dict[str, tuple[Path, ...]] = {}
    problems: list[str] = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            name, files = path.name, frames_in(path, problems)
        elif path.suffix.lower() in MODEL_SUFFIXES:
            name, files = path.stem, (path,)
        else:
            if path.suffix.lower() not in BESIDE:
                problems.append(f"{path}: is no model that can be read; expected {FORMATS}")
            continue
        if not files:
            continue
        try:
            check_safe_name(name)
        except ValueError as error:
            problems.append(f"{path}: {error}")
        if name in models:
            problems.append(f"{path}: {models[name][0]} is a model of {name}, too; keep one of them")
        models[name] = files
    if not models and not problems:
        problems.append(f"{folder}: holds no model; expected APPROACH/FRAME or APPROACH with an ending of {FORMATS}")
    return models, problems


def frames_in(folder: Path, problems: list[str]) -> tuple[Path, ...]:
    """Find the models of an approach in the order of their numbers, and add to `problems` what is wrong with these."""
    files = [path for path in sorted(folder.iterdir()) if not path.is_dir() and not path.name.startswith(".")]
    frames = [path for path in files if path.suffix.lower() in MODEL_SUFFIXES]
    if not frames:
        if any(path.name == SOG for path in files) and any(path.suffix.lower() == ".webp" for path in files):
            problems.append(f"{folder}: is a SOG that is not bundled; zip its files as {folder.name}.sog")
        elif not files or any(path.suffix.lower() not in BESIDE for path in files):
            problems.append(f"{folder}: holds no model that can be read; expected numbered files with {FORMATS}")
        return ()
    by_number: dict[int, Path] = {}
    letters: dict[str, Path] = {}
    for path in frames:
        match = NUMBERED.fullmatch(path.stem)
        if match is None:
            problems.append(f"{path}: its name does not end in the number of a frame, such as 0000{path.suffix}")
            continue
        letters.setdefault(match[1], path)
        number = int(match[2])
        if number in by_number:
            problems.append(f"{path}: is frame {number}, as {by_number[number].name} is; keep one of them")
        by_number[number] = path
    if len(letters) > 1:
        first, second, *_ = letters.values()
        problems.append(f"{folder}: holds two sequences, {first.name} and {second.name}; give each a folder of its own")
    elif by_number:
        lowest, highest = min(by_number), max(by_number)
        if n_missing := highest + 1 - lowest - len(by_number):  # a time as a number leaves out very many
            some = islice((number for number in range(lowest, highest) if number not in by_number), MOST_NAMED)
            more = f" and {n_missing - MOST_NAMED} more" if n_missing > MOST_NAMED else ""
            problems.append(
                f"{folder}: frame {', '.join(map(str, some))}{more} is missing between {by_number[lowest].name} and "
                f"{by_number[highest].name}"
            )
    return tuple(by_number[number] for number in sorted(by_number))
