"""List the packages that a server and the reconstruction are made of, with their licences, in THIRD_PARTY.md.

    make lock

A licence that is not allowed beside the MIT licence of this project ends it with 1: a program that imports a package
under the GPL would have to be under the GPL itself.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

ROOT = Path(__file__).parent.parent
OUT = ROOT / "THIRD_PARTY.md"
PARTS = {"server": "A server", "recon": "What the reconstruction adds"}
# Weak copyleft is allowed (LGPL, MPL): it is about changes to the package itself, which we only import.
ALLOWED = frozenset(
    """0BSD, Apache-2.0, BSD-2-Clause, BSD-3-Clause, CC0-1.0, ISC, LGPL-3.0-only, LLVM-exception, MIT, MIT-0, MIT-CMU,
    MPL-2.0, PSF-2.0, Unlicense, Zlib, Apache 2, Apache 2.0, Apache Software License, BSD, BSD 3-Clause License,
    BSD License, ISC License (ISCL), MIT License, Mozilla Public License 2.0 (MPL 2.0),
    Python Software Foundation License""".replace("\n    ", " ").split(", ")
)
BY_HAND = {  # read in their files, where the metadata say nothing or the package is for another system
    "htmx-ext-sse": "0BSD",
    "open3d": "MIT",
    "openexr": "BSD-3-Clause",
    "pyglet": "BSD-3-Clause",
    "pyrage": "MIT",
    "tzdata": "Apache-2.0",
}
HEAD = """# Packages of others

Made by `make lock`. This project is under the MIT licence (`LICENSE`); it imports these packages, each under a licence
of its own.

FFmpeg is none of them: `imageio-ffmpeg` brings its program, which is under the GPL (version 3, as it is built with
x264 and x265). It runs as a process of its own, and nothing here is linked with it.
"""


@dataclass(frozen=True)
class Package:
    """A package at its locked version, with the licences that it states."""

    name: str
    version: str
    licences: tuple[str, ...]

    def refused(self) -> list[str]:
        """Return the licences that are not allowed."""
        return [licence for licence in self.licences or ("none stated",) if licence not in ALLOWED]


def main() -> int:
    parts = {title: list(locked_packages(part)) for part, title in PARTS.items()}
    parts["Pages in a browser"] = list(browser_packages())
    refused = [
        f"{each.name}: {', '.join(each.refused())}" for part in parts.values() for each in part if each.refused()
    ]
    if refused:
        print("\n".join(["These licences are not in ALLOWED of deploy/third_party.py:", *refused]), file=sys.stderr)
        return 1
    OUT.write_text(listed(parts), encoding="utf-8")
    return 0


def listed(parts: dict[str, list[Package]]) -> str:
    """Return the page of packages by part."""
    text = HEAD
    for title, packages in parts.items():
        text += f"\n## {title}\n\n| package | version | licence |\n|---|---|---|\n"
        text += "".join(f"| {each.name} | {each.version} | {', '.join(each.licences)} |\n" for each in packages)
    return text


def locked_packages(part: str) -> Iterator[Package]:
    """Yield the packages of a lock file; a PackageNotFoundError says that one is not installed."""
    text = (ROOT / f"requirements-{part}.lock").read_text(encoding="utf-8")
    for name, version in dict.fromkeys(re.findall(r"^([\w.-]+)==([^ ;]+)", text, re.MULTILINE)):
        yield Package(name, version, (BY_HAND[name],) if name in BY_HAND else installed_licences(name))


def browser_packages() -> Iterator[Package]:
    """Yield the packages that browsers load."""
    packages = json.loads((ROOT / "frontend/package-lock.json").read_text(encoding="utf-8"))["packages"]
    for path, stated in packages.items():
        name = path.rpartition("node_modules/")[2]
        if name and not stated.get("dev"):
            yield Package(name, stated["version"], (stated.get("license") or BY_HAND.get(name, "none stated"),))


def installed_licences(name: str) -> tuple[str, ...]:
    """Return the licences of an installed package."""
    try:
        return stated_licences(distribution(name))
    except PackageNotFoundError as error:
        raise PackageNotFoundError(f"{name} is locked and not installed: run `make setup`, then this again") from error


def stated_licences(package: Distribution) -> tuple[str, ...]:
    """Return what the metadata state, in this order: an SPDX expression, classifiers, the first line of a text."""
    expression, classifiers, text = (
        package.metadata.get_all(key) or [] for key in ("License-Expression", "Classifier", "License")
    )
    if expression:
        return tuple(re.split(r" (?:AND|OR|WITH) ", re.sub("[()]", "", expression[0])))
    classified = [line for line in classifiers if line.startswith("License ::")]
    if classified:
        return tuple(line.rpartition(" :: ")[2] for line in classified)
    return tuple(text[0].strip().splitlines()[:1]) if text else ()


if __name__ == "__main__":
    sys.exit(main())
