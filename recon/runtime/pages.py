"""Reports as HTML pages that need no other file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def report_page(package: str, content: Mapping[str, Any], **filters: Callable[..., Any]) -> bytes:
    """Render the template `report.html` of a package: it escapes HTML, and what it names and nobody gave is an error.

    Parameters
    ----------
    package : which holds the template
    content : by name
    filters : that the template uses
    """
    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters)
    return environment.get_template("report.html").render(content).encode("utf-8")
