"""The whole methods file as one model, for its JSON Schema and its page of reference.

The file is read table by table, each by the same model, where its kind of method is run (`recon.methods.methods_file`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, create_model

from ground.dataclass_models import model_of
from ground.file_models import FilePart
from recon.depth import DEFAULTS
from recon.depth.program import DepthProgram
from recon.depth.temporal import TemporalParameters
from recon.fusion import FUSIONS
from recon.fusion.program import FusionProgram
from recon.methods.plugins import default_parameters
from recon.pipeline.methods import NO_SEED
from recon.runtime.programs import Program
from recon.validation.cloud_quality.programs import MeasureProgram

Parts = tuple[type[FilePart], ...]
OURS = "which of ours; the other parameters keep their defaults"


class PlugInTable(FilePart):
    """A variant of a method that a package brings; its parameters are those of the package."""

    model_config = ConfigDict(extra="allow")

    method: Annotated[
        str,
        Field(
            description="the name of a method that an installed package brings",
            json_schema_extra={"not": {"enum": [*DEFAULTS, *FUSIONS]}},  # whose parameters are known
        ),
    ]


def methods_file() -> type[FilePart]:
    """Return the model of a methods file: tables by the kind and the name of a method."""
    return create_model(
        "MethodsFile",
        __base__=FilePart,
        __doc__="The tables of a methods file: [depth.NAME], [fusion.NAME], [measure.NAME] and [film.NAME].",
        depth=_tables(depth_tables(), "methods that match pairs"),
        fusion=_tables(fusion_tables(), "methods that make one mesh of all sensors' clouds"),
        measure=_tables(measure_tables(), "measures between two clouds"),
        film=_tables(measure_tables(), "measures between two films"),
    )


def depth_tables() -> Parts:
    """Return the models of the tables [depth.NAME]."""
    temporal: dict[str, Any] = {"temporal": _part(TemporalParameters, "the filter in time; empty: as the run says")}
    seed = {
        "pm": {"seed": _part(type(DEFAULTS["dr"]), "of the surface to start from; none: planes at random", NO_SEED)}
    }
    ours = _variants({name: type(parameters) for name, parameters in DEFAULTS.items()}, temporal, seed)
    return (*ours, _program(DepthProgram, temporal), PlugInTable)


def fusion_tables() -> Parts:
    """Return the models of the tables [fusion.NAME]."""
    ours = _variants({name: type(default_parameters(fusion)) for name, fusion in FUSIONS.items()}, {}, {})
    return (*ours, _program(FusionProgram, {}), PlugInTable)


def measure_tables() -> Parts:
    """Return the models of the tables [measure.NAME] and [film.NAME]."""
    return (model_of(MeasureProgram, frozenset({"folder", "output"})),)


def _tables(kinds: Iterable[type[FilePart]], words: str) -> Any:
    kind: Any = reduce(or_, kinds)
    return dict[str, kind], Field(default_factory=dict, description=f"{words}, by name")


def _variants(
    methods: Mapping[str, type[Any]], more: Mapping[str, Any], special: Mapping[str, Mapping[str, Any]]
) -> list[type[FilePart]]:
    return [
        create_model(
            f"{name.capitalize()}Table",
            __base__=model_of(kind),
            __doc__=f"A variant of {name}.",
            **{"method": (Literal[name], Field(description=OURS)), **more, **special.get(name, {})},
        )
        for name, kind in methods.items()
    ]


def _part(kind: type[Any], words: str, *instead: str) -> Any:
    model = model_of(kind)
    kinds: Any = reduce(or_, (Literal[name] for name in instead), model)
    return kinds, Field(default_factory=model, description=words)


def _program(kind: type[Program], more: Mapping[str, Any]) -> type[FilePart]:
    output: dict[str, Any] = {"output": (Literal[kind.OUTPUTS], Field(description="format of what it writes"))}
    return create_model(kind.__name__, __base__=model_of(kind, frozenset({"folder"})), **output, **more)
