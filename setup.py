"""What pyproject.toml cannot say: the folders beside `app` that a wheel carries inside it (app/files.py finds them)."""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

FOLDERS = ("docs", "languages", "migrations", "static", "templates")


class BuildWithFolders(build_py):
    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        if not Path("static/vendor/htmx.min.js").is_file():
            raise SystemExit(
                "static/vendor is missing, which pages need: frontend/vendor.sh fetches it (make setup runs it)"
            )
        for name in FOLDERS:
            target = Path(self.build_lib, "app", name)
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(name, target, ignore=shutil.ignore_patterns("__pycache__", *("*.py",) * (name == "docs")))


setup(cmdclass={"build_py": BuildWithFolders})
