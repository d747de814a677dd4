"""The words of the code: what a public docstring must tell, and names that say nothing."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # all code is parsed

ROOT = Path(__file__).parent.parent
RIDDLES = {"of", "one", "own", "found"}
DOCUMENTED = ("ground", "recon", "app/study", "app/analysis")
MANY_PARAMETERS = 3
SHAPE = re.compile(r"\((?:\.{3}|…|[\w*+ -]+),[^()]*\)|\(\)|scalar")

Function = ast.FunctionDef | ast.AsyncFunctionDef


def python_files(*folders: str) -> list[Path]:
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def module_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def public_functions(path: Path) -> Iterator[Function]:
    """Functions of a module and methods of its classes whose names do not begin with an underscore."""
    module = module_of(path)
    classes = [node for node in module.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    for node in [*module.body, *(node for owner in classes for node in owner.body)]:
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield node


def parameters(function: Function) -> list[ast.arg]:
    """A function's parameters but for the object that a method belongs to, or that an operation is built with."""
    given = function.args
    return [
        argument
        for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs)
        if not argument.arg.startswith(("self", "cls", "builder", "_"))
    ]


def handles_arrays(function: Function) -> bool:
    annotations = [argument.annotation for argument in parameters(function)] + [function.returns]
    return any("NDArray" in ast.unparse(annotation) for annotation in annotations if annotation is not None)


def bound_names(path: Path) -> Iterator[tuple[int, str]]:
    """Names that a module gives to parameters and variables."""
    for node in ast.walk(module_of(path)):
        if isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id


def documented_functions() -> Iterator[tuple[str, Function]]:
    """Public functions of the modules whose docstrings are held to rules, each with its place."""
    for path in python_files(*DOCUMENTED):
        if not name_of(path).startswith("recon/cli/"):
            for function in public_functions(path):
                yield f"{name_of(path)}:{function.lineno} {function.name}", function


def test_a_public_function_of_three_parameters_explains_them() -> None:
    silent = [
        place
        for place, function in documented_functions()
        if len(parameters(function)) >= MANY_PARAMETERS and "\n    Parameters\n" not in _indented(function)
    ]
    assert silent == []


def test_a_public_function_on_arrays_gives_their_shapes() -> None:
    silent = [
        place
        for place, function in documented_functions()
        if handles_arrays(function) and not SHAPE.search(ast.get_docstring(function) or "")
    ]
    assert silent == []


def test_names_are_nouns() -> None:
    riddles = [
        f"{name_of(path)}:{line} {name}"
        for path in python_files("app", "ground", "recon")
        for line, name in bound_names(path)
        if name in RIDDLES
    ]
    assert riddles == []


def _indented(function: Function) -> str:
    return "\n    " + (ast.get_docstring(function) or "").replace("\n", "\n    ")
