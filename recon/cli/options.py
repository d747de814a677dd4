"""Options that several commands share, and how to read sizes, frame ranges, view pairs, places and boxes."""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, get_origin

import typer
from pydantic import ValidationError
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from ground.fields import plain
from ground.file_models import fault_of
from recon.cli.commands.setting import PLUGIN_NAMES
from recon.methods.approaches import Approach, parse_approach
from recon.methods.plugins import DEPTH_GROUP, FUSION_GROUP
from recon.runtime.remote import is_there, place

if TYPE_CHECKING:
    from recon.pipeline.methods import Methods

SCHEME = re.compile(r"[a-z][a-z0-9+.-]+:", re.IGNORECASE)  # of a URL, as a path's first part

# What helps call types of Python.
TYPES = {"str": "text", "int": "number", "float": "number", "Path": "path", "dir": "folder"}

PLUGIN_GROUPS = {"method": DEPTH_GROUP, "depth": DEPTH_GROUP, "fusion": FUSION_GROUP}


class LocalPathsGroup(TyperGroup):
    """The root of all commands: where one of them takes no URL, it refuses one, instead of a folder called `s3:`."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        for command in _commands_of(self):
            for parameter in command.params:
                parameter.callback = parameter.callback or refuse_url
        _tell_types_in_words()

    def invoke(self, ctx: Any) -> Any:
        """Run a command; a value that typer refuses is refused in the words of all our refusals."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if error.param is not None and isinstance(error.__cause__, ValidationError):
                error.message = _in_words(error.param, error.__cause__)
            raise


class MethodsCommand(TyperCommand):
    """A command that takes names of methods. Its help tells those of plug-ins, which nothing else waits for."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the names of the plug-ins, which are not imported for it."""
        for parameter in self.params:
            group = PLUGIN_GROUPS.get(parameter.name or "")
            if group and isinstance(parameter, TyperOption) and parameter.help:
                names = "".join(f"{name}, " for name in installed_names(group))
                parameter.help = parameter.help.replace(f"{PLUGIN_NAMES}, ", names)
        super().format_help(ctx, formatter)


def _tell_types_in_words() -> None:
    """Let helps name no types of Python, which some versions of typer write, even behind flags that take no value."""
    for parameter in (TyperOption, TyperArgument):
        shown = getattr(parameter, "display_type_rich", None)
        if shown is not None and shown.__name__ != "told":
            parameter.display_type_rich = _told_by(shown)  # type: ignore[method-assign]  # no setting


def _told_by(shown: Callable[..., str | None]) -> Callable[..., str | None]:
    def told(parameter: Any, ctx: Any) -> str | None:
        if getattr(parameter, "is_flag", False):
            return None
        text = shown(parameter, ctx) or ""
        if not text.startswith("<"):
            return text
        bare = re.sub(r"list\[(.+)\]|(\w+) range", r"\1\2", text)
        return re.sub(r"\w+", lambda word: TYPES.get(word[0], word[0]), bare)

    return told


def _in_words(parameter: Any, refused: ValidationError) -> str:
    bounds = SimpleNamespace(ge=getattr(parameter, "min", None), le=getattr(parameter, "max", None))
    within, detail = plain(parameter.type_descriptor.annotation, [bounds]), refused.errors(include_url=False)[0]
    if get_origin(within.kind) is Literal:  # which typer's own check names in its words
        detail["type"] = "literal_error"
    return fault_of(detail, detail["loc"], within).words.removeprefix("is ")


def _commands_of(group: TyperGroup) -> Iterator[Any]:
    for command in group.commands.values():
        if isinstance(command, TyperGroup):
            yield from _commands_of(command)
        else:
            yield command


def refuse_url(_context: Any, _parameter: Any, value: Any) -> Any:
    """Return a parameter's value; URLs that a command takes have become the paths of their copies before."""
    for path in value if isinstance(value, list | tuple) else [value]:
        if isinstance(path, Path) and path.parts and SCHEME.fullmatch(path.parts[0]):
            address = f"{path.parts[0]}//{'/'.join(path.parts[1:])}"
            raise typer.BadParameter(
                f"{address} is a URL; expected a file or folder of this machine: copy it here first"
            )
    return value


def installed_names(group: str) -> list[str]:
    """List the names of the installed plug-ins of a group."""
    return sorted({entry.name for entry in entry_points(group=group)})


def find_methods(path: Path | None) -> Methods:
    """Find all methods, those of a file included, and tell of plug-ins that are left out."""
    from recon.methods.plugins import PluginWarning
    from recon.pipeline.methods import read_methods

    with telling(PluginWarning):
        return read_methods(path)


@contextmanager
def telling(kind: type[Warning]) -> Iterator[None]:
    """Print warnings of a kind on standard error once all is done or has failed, one a line, each once."""
    told: list[str] = []
    show = warnings.showwarning

    def keep(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if not issubclass(category, kind):
            show(message, category, *place, **more)
        elif str(message) not in told:
            told.append(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("always", kind)
        warnings.showwarning = keep
        try:
            yield
        finally:
            for message in told:
                typer.echo(f"warning: {message}", err=True)


def parse_size(text: str) -> tuple[int, int]:
    """Read (width, height) from "WIDTHxHEIGHT"."""
    size = re.fullmatch(r"(\d+)x(\d+)", text)
    if size is None:
        raise typer.BadParameter(f"{text!r} is not a size; expected WIDTHxHEIGHT, for example 1920x1080")
    return int(size[1]), int(size[2])


def split_names(text: str) -> tuple[str, ...]:
    """Read the names in "a,b,c" as they are written."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def parse_names(text: str) -> tuple[str, ...]:
    """Read the names of ours in "a,b,c", which have no capitals."""
    return split_names(text.lower())


def parse_approaches(text: str) -> tuple[Approach, ...]:
    """Read the approaches in "sgm_fb,pm_poisson"."""
    return tuple(map(parse_approach, parse_names(text)))


def parse_frames(text: str | None) -> range | None:
    """Read the frames of "N", which are the first N, or of "A:B"; either end may be left out for the first or last."""
    if text is None:
        return None
    if text.isascii() and text.isdigit() and int(text):
        return range(int(text))
    ends = re.fullmatch(r"(\d*):(\d*)", text)
    if ends is None:
        raise typer.BadParameter(
            f"{text!r} are no frames; expected their number, for example 25, or A:B, for example 0:25"
        )
    return range(int(ends[1] or 0), int(ends[2]) if ends[2] else sys.maxsize)


def parse_pairs(text: str) -> tuple[tuple[int, int], ...]:
    """Read the view numbers of "13-14,20-21"."""
    pairs = [re.fullmatch(r"(\d+)-(\d+)", pair.strip()) for pair in text.split(",")]
    if not all(pairs):
        raise typer.BadParameter(f"{text!r} are not pairs of views; expected for example 13-14,20-21")
    return tuple((int(pair[1]), int(pair[2])) for pair in pairs if pair)


@contextmanager
def wrong_use() -> Iterator[None]:
    """Refuse as wrong use, by the exit status 2, what the block finds wrong with the options' values."""
    try:
        yield
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def parse_place(address: str) -> Path:
    """Find the folder that a path or an fsspec URL names."""
    with wrong_use():
        return place(address)


def parse_path(text: str, kinds: Collection[str]) -> str | Path:
    """Read the kind of a camera path, or find the file of one."""
    if text == "auto" or text in kinds:
        return text
    file = parse_place(text).resolve()
    if not is_there(file):
        raise typer.BadParameter(f"{text!r} is no file of cameras, and none of auto, {', '.join(kinds)}")
    return file


def parse_floor(text: str, places: Collection[str]) -> str | float:
    """Read where a floor is: one of the names, or its height, mm."""
    if text in places:
        return text
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no height in mm, and none of {', '.join(places)}") from None


def parse_loops(texts: list[str], static: str) -> tuple[str, dict[str, str]]:
    """Read loops such as "bounce" and "pm_fb=repeat"; returns the one of all approaches, and those of single ones.

    Parameters
    ----------
    texts : as given
    static : approaches that do not move, separated by commas
    """
    loops = dict.fromkeys(split_names(static), "static")
    for text in texts:
        name, _, loop = (part.strip() for part in text.rpartition("="))
        if (before := loops.setdefault(name, loop)) != loop:
            raise typer.BadParameter(f"{name or 'all'} would be both {before} and {loop}; leave one of them out")
    return loops.pop("", "bounce"), loops


def parse_by_sensor(texts: Sequence[str], flag: str, unit: str) -> tuple[tuple[str, float], ...]:
    """Parse the SENSOR=NUMBER of a flag, each sensor once; `unit` is what the number counts."""
    values: dict[str, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        try:
            values[name] = float(number)
        except ValueError as error:
            raise typer.BadParameter(f"{flag} {text!r}: expected SENSOR={unit}, such as S3=0.5") from error
    return tuple(values.items())


def parse_position(text: str) -> tuple[float, float, float]:
    """Read the numbers of "x,y,z"."""
    try:
        x, y, z = (float(value) for value in text.split(","))
    except ValueError:
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise typer.BadParameter(f"{text!r} is not a position; expected x,y,z in mm")
    return x, y, z


def parse_bounds(text: str | None) -> Any:
    """Read bounds, (2, 3) in mm, from "x0,y0,z0,x1,y1,z1"; None stays None."""
    if text is None:
        return None
    import numpy as np

    try:
        return np.array([float(value) for value in text.split(",")]).reshape(2, 3)
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} are not bounds; expected x0,y0,z0,x1,y1,z1 in mm") from error
