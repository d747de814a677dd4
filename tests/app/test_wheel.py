"""The wheel gives everything: made and installed by the Dockerfile's own steps, it works where no checkout is.

What those steps fetch comes from the tests' environment instead: the packages that a lock file names are linked into a
new environment, which so has these and nothing else.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import distribution
from pathlib import Path
from shutil import copy, copytree, ignore_patterns, unpack_archive
from urllib.request import urlopen
from zipfile import ZipFile

import pytest

from recon.capture.masks.segment import segment_capture
from recon.studio import SynthParameters, synthesise
from tests.containers import ROOT, arguments_of, copied_files
from tests.locks import RECON, SERVER, locked

pytestmark = pytest.mark.slow
VOTES = "participant,dataset,item_a,item_b,choice\n" + "".join(
    f"p{n},ball,{a},{b},{'a' if n % 3 else 'b'}\n" for n in range(6) for a, b in ("xy", "yz", "xz")
)


class Installed:
    """A virtual environment with the wheel and the packages of some lock files, and an empty folder to work in."""

    def __init__(self, wheels: Path, folder: Path, *locks: str) -> None:
        self.work = folder / "work"
        self.work.mkdir(parents=True)
        self.environment = folder / "100%"  # which a careless path in a setting would stumble over
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", self.environment], check=True)
        self.packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(self.environment)}))
        for requirement in locked(*locks):
            if requirement.marker is None or requirement.marker.evaluate():
                self._link(requirement.name)
        (command,) = arguments_of("server", "RUN", "--no-deps")
        pip = f"'{sys.executable}' -m pip --python '{self.environment}/bin/python' --quiet"
        shell(command.replace("pip", pip, 1).replace("/wheels", str(wheels)), folder)

    def _link(self, name: str) -> None:
        package = distribution(name)
        for top in {file.parts[0] for file in package.files or ()} - {"..", "__pycache__"}:
            if not (self.packages / top).exists():  # several packages may share a folder
                (self.packages / top).symlink_to(str(package.locate_file(top)))

    def take_over_kernels(self) -> None:
        """Copy what numba has compiled here, as it takes a minute; numba uses it where the source is the same."""
        for compiled in (ROOT / "recon").rglob("__pycache__/*.nb[ci]"):
            copy(compiled, self.packages / compiled.relative_to(ROOT).parent)

    def run(self, program: str, *arguments: object) -> str:
        """What a program of the environment prints, in the empty folder."""
        return shell([self.environment / "bin" / program, *map(str, arguments)], self.work)

    @contextmanager
    def server(self) -> Iterator[str]:
        """`reconstudy serve`, and its address."""
        command = [self.environment / "bin" / "reconstudy", "serve", "--port", "0"]
        with subprocess.Popen(
            command, cwd=self.work, env=environment_variables(), stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout
            try:
                (address,) = re.findall(r"http://\S+", process.stdout.readline())
                yield address
            finally:
                process.terminate()


def shell(command: str | list[Path | str], folder: Path) -> str:
    done = subprocess.run(
        command,
        shell=isinstance(command, str),
        cwd=folder,
        env=environment_variables(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def environment_variables() -> dict[str, str]:
    """Those of the tests, but nothing that leads to the checkout or to settings; its pip comes first."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "RECONSTUDY_"))}
    return kept | {"PATH": f"{Path(sys.executable).parent}:{kept['PATH']}"}


def build_wheel(source: Path) -> Path:
    """Build as the image's build stage does; returns the folder of the wheel."""
    (command,) = arguments_of("build", "RUN", "pip wheel")
    shell(command.replace("/wheels", "wheels"), source)
    return source / "wheels"


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel that the build stage makes of the files it copies, and of the browser packages."""
    if Path(sys.prefix, ".npm-unreachable").exists():
        pytest.skip("npm's registry could not be reached by `make setup`, so there are no browser packages to pack")
    folder = tmp_path_factory.mktemp("build")
    for name in copied_files("build"):
        if (ROOT / name).is_dir():
            copytree(ROOT / name, folder / name, ignore=ignore_patterns("__pycache__", "node_modules"))
        else:
            copy(ROOT / name, folder)
    return build_wheel(folder)


@pytest.fixture(scope="module")
def server(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """What the image `server` has."""
    return Installed(wheels, tmp_path_factory.mktemp("server"), SERVER)


@pytest.fixture(scope="module")
def recon(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """What the image `recon` has."""
    installed = Installed(wheels, tmp_path_factory.mktemp("recon"), SERVER, RECON)
    installed.take_over_kernels()
    return installed


def test_the_program_runs_from_the_wheel_and_has_no_packages_but_its_own(server: Installed) -> None:
    for package in ("app", "ground", "recon"):
        file = server.run("python", "-c", f"import {package}; print({package}.__file__)")
        assert file.strip() == str(server.packages / package / "__init__.py")
    others = "import importlib.util as u; print([m for m in ('cv2', 'numba', 'open3d', 'pytest') if u.find_spec(m)])"
    assert server.run("python", "-c", others).strip() == "[]"


def test_the_source_distribution_makes_the_same_wheel(wheels: Path, tmp_path: Path) -> None:
    source = wheels.parent
    copy(ROOT / "MANIFEST.in", source)
    shell([sys.executable, "-c", "from setuptools import build_meta; build_meta.build_sdist('sdist')"], source)
    (packed,) = (source / "sdist").iterdir()
    unpack_archive(packed, tmp_path, filter="data")
    (unpacked,) = tmp_path.iterdir()
    assert not (unpacked / "tests").exists()
    contents = [
        sorted(ZipFile(wheel).namelist()) for folder in (wheels, build_wheel(unpacked)) for wheel in folder.iterdir()
    ]
    assert contents[0] == contents[1]


def test_the_documentation_names_the_wheel_that_is_built(wheels: Path) -> None:
    (wheel,) = wheels.iterdir()
    for page in ("README.md", "docs/operations.md"):
        named = set(re.findall(r"reconstudy-[\w.-]+\.whl", (ROOT / page).read_text(encoding="utf-8")))
        assert named == {wheel.name}


def test_it_tells_its_version(server: Installed) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert server.run("reconstudy", "--version") == f"reconstudy {project['version']}\n"


def test_it_makes_and_upgrades_a_database(server: Installed) -> None:
    newest = max((ROOT / "migrations" / "versions").glob("0*.py")).name[:4]
    assert newest in server.run("reconstudy", "db", "upgrade")


def test_it_serves_pages_with_their_style_and_browser_packages(server: Installed) -> None:
    with server.server() as address:
        page = urlopen(address).read().decode()
        (style, *_) = re.findall(r'href="(/static/css/[^"]+)"', page)
        for path in (style, "/static/vendor/htmx.min.js", "/static/js/participant.js", "/healthz"):
            with urlopen(address + path) as answer:
                assert answer.status == 200
                assert answer.read()


def test_it_analyses_votes(server: Installed) -> None:
    (server.work / "votes.csv").write_text(VOTES, encoding="utf-8")
    server.run("reconstudy", "analyse", "votes.csv", "-o", "results")
    assert "</html>" in (server.work / "results" / "report.html").read_text(encoding="utf-8")


def test_it_has_the_papers_numbers(server: Installed) -> None:
    code = "from app.files import packaged; print(packaged('experiment/paper.toml').read_text())"
    assert tomllib.loads(server.run("python", "-c", code))


def test_it_runs_the_whole_demo(recon: Installed) -> None:
    """With smaller films than its own, of a smaller recording: the demo goes on from what is there."""
    for folder, scene in (("demo/capture", "ball"), ("demo/practice/capture", "box")):
        synthesise(recon.work / folder, SynthParameters(scene, n_frames=2, size=(90, 160)))
        segment_capture(recon.work / folder)
    told = recon.run("reconstudy", "demo", "--no-serve", "--participants", 1, "--port", 0, "--size", "160x90")
    assert "To see its pages:    reconstudy demo --out demo\n" in told
    assert "http://" not in told, "links of a server that has ended"
    assert "</html>" in (recon.work / "demo" / "analysis" / "report.html").read_text(encoding="utf-8")


def test_no_wheel_is_built_without_the_browser_packages(tmp_path: Path) -> None:
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        copy(ROOT / name, tmp_path)
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").touch()
    with pytest.raises(AssertionError, match=r"static/vendor is missing.*frontend/vendor\.sh"):
        build_wheel(tmp_path)
