"""Methods of others that are installed as Python packages, found by their entry points.

Names are read from the packages' metadata. So a package is imported only when its method is used, and one that is
broken disturbs no other.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, is_dataclass
from functools import cache
from hashlib import sha256
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

from recon.methods.approaches import check_method_name

DEPTH_GROUP, FUSION_GROUP, MEASURES_GROUP = "reconstudy.depth", "reconstudy.fusion", "reconstudy.measures"


class PluginError(ValueError):
    """A plug-in that cannot be used."""


class PluginWarning(UserWarning):
    """A plug-in that is left out because of its name."""


@dataclass(frozen=True)
class Plugin:
    """An entry point of an installed package, not imported yet.

    Parameters
    ----------
    name : of the method
    target : what the entry point names, MODULE:NAME
    package, version : which bring it
    """

    name: str
    target: str
    package: str
    version: str

    def __str__(self) -> str:
        return f"plug-in {self.name} of {self.package} {self.version}"

    @contextmanager
    def running(self, *answers: type[Exception], failure: str = "failed") -> Iterator[None]:
        """Run its code: any error but these is a PluginError, and what it prints goes to standard error.

        What a command prints may be JSON, and a sys.exit would end it as if all were done.
        """
        try:
            with redirect_stdout(sys.stderr):
                yield
        except answers:
            raise
        except (Exception, SystemExit) as error:
            raise PluginError(f"{self} {failure}: {error!r}") from error

    def load(self) -> Callable[..., Any]:
        """Import the function that the entry point names, or raise a PluginError that says what is wrong."""
        with self.running(failure=f"cannot be imported ({self.target})"):
            function: object = EntryPoint(self.name, self.target, "").load()
        if not callable(function):
            raise PluginError(f"{self} is no method: it is a {type(function).__name__}, expected a function")
        return function

    def code_version(self) -> str:
        """Digest the source of its module, or of all modules of its package, after it was loaded."""
        return _source_digest(self.target.partition(":")[0].partition(".")[0])


def default_parameters(function: Callable[..., Any]) -> object | None:
    """Return the parameters that a method has by default: a dataclass, the default of its second parameter.

    None says that it takes nothing but the pair, or the clouds. A TypeError says that it is no such function.
    """
    positional = [
        parameter
        for parameter in signature(function).parameters.values()
        if parameter.kind in (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD) and parameter.name != "views"
    ]
    if len(positional) == 1:
        return None
    if len(positional) != 2:
        names = ", ".join(parameter.name for parameter in positional)
        raise TypeError(f"it takes ({names}), expected what it works on, and at most its parameters")
    default: object = positional[1].default
    if not is_dataclass(default) or isinstance(default, type):
        raise TypeError(f"the default of {positional[1].name} is no object of a dataclass, which its parameters are")
    return default


def registered(group: str, taken: Collection[str] = ()) -> dict[str, Plugin]:
    """Find the plug-ins of a group by the methods' names, without importing them.

    A plug-in is left out, with a PluginWarning that names it, if its name is taken, another package's too, or no
    safe name for a method.

    Parameters
    ----------
    group : of entry points
    taken : names of this program's methods
    """
    plugins = sorted(map(_plugin, set(entry_points(group=group))), key=str)
    times = Counter(plugin.name for plugin in plugins)
    usable: dict[str, Plugin] = {}
    for plugin in plugins:
        problem = _name_problem(plugin, taken)
        if times[plugin.name] > 1:
            others = [str(other) for other in plugins if other.name == plugin.name and other != plugin]
            problem = problem or f"its name is also that of {', '.join(others)}: remove one"
        if problem:
            warnings.warn(f"{plugin} is left out: {problem}", PluginWarning, stacklevel=2)
        else:
            usable[plugin.name] = plugin
    return usable


def _plugin(entry: EntryPoint) -> Plugin:
    package = entry.dist
    if package is None:
        return Plugin(entry.name, entry.value, "an unknown package", "")
    return Plugin(entry.name, entry.value, package.name, package.version)


def _name_problem(plugin: Plugin, taken: Collection[str]) -> str:
    if plugin.name in taken:
        return f"{plugin.name} is a method of this program"
    try:
        check_method_name(plugin.name)
    except ValueError as error:
        return str(error)
    return ""


@cache
def _source_digest(module: str) -> str:
    loaded = import_module(module)
    if folders := getattr(loaded, "__path__", ()):  # of a package, with an __init__.py or without
        sources = sorted(source for folder in folders for source in Path(folder).rglob("*.py"))
    else:
        sources = [Path(loaded.__file__ or "")]
    digest = sha256()
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()
