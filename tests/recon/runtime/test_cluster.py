"""Reconstruction and rendering on a Dask cluster: the same files as here, also when a worker is lost on the way."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numba
import pytest
from distributed import LocalCluster
from s3fs import S3FileSystem

from recon.cli.console import ProgressLine
from recon.pipeline.film import RenderOptions
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.pipeline.run import LOG_FILE
from recon.runtime.artefacts import file_digest
from recon.runtime.remote import place
from recon.runtime.workers import RETRIES, open_pool
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command
from tests.object_store import BUCKET, object_store

pytestmark = [
    pytest.mark.slow,
    # distributed's own, when a cluster whose worker was killed is closed
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning"),
]


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with (
        object_store(),  # before the workers, so that they get its keys
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
        ) as cluster,
    ):
        yield cluster


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=2, size=(240, 180), noise=0.5))
    return folder


def digests(folder: Path) -> dict[str, str]:
    """Of everything that was made but what says when and how fast."""
    kinds = (".tiff", ".npy", ".ply", ".png", ".mp4", ".quality.json")
    return {
        str(path.relative_to(folder)): file_digest(path)
        for path in sorted(folder.rglob("*"))
        if (path.name.endswith(kinds) or path.parent.name == "rows") and ".finished" not in path.parts
    }


def flaky(mark: Path) -> str:
    """Fails as a disk or a network does, as often as a task is tried again."""
    tried = len(list(mark.iterdir()))
    (mark / str(tried)).touch()
    if tried < RETRIES:
        raise OSError("stale file handle")
    return "done"


def wrong(mark: Path) -> None:
    (mark / str(len(list(mark.iterdir())))).touch()
    raise ValueError("the mask is upside down")


def kill_a_worker_at_progress(cluster: LocalCluster, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Kill a worker once a first task on the cluster is done and others are on their way; its process, then."""
    killed: list[int] = []
    tell = ProgressLine.__call__

    def tell_and_kill(line: ProgressLine, what: str, done: int, total: int) -> None:
        tell(line, what, done, total)
        if done == 1 and not killed:
            killed.append(int(next(iter(cluster.workers.values())).pid))
            os.kill(killed[0], signal.SIGKILL)

    monkeypatch.setattr(ProgressLine, "__call__", tell_and_kill)
    return killed


def make_films(command: Command, capture: Path, folder: Path, *where: str) -> None:
    told = command("reconstruct", capture, "-o", folder, "--depth", "id", *where)
    assert told.code == 0, told.err
    film = ("--size", "96x64", "--seconds", 1, "--renderer", "software")
    told = command("render", folder, "-o", folder / "set", *film, *where)
    assert told.code == 0, told.err
    assert "video frames: 50/50" in told.err


def test_a_cluster_makes_the_files_of_a_single_process_though_a_worker_is_killed(
    command: Command, cluster: LocalCluster, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_films(command, capture, tmp_path / "here")
    killed = kill_a_worker_at_progress(cluster, monkeypatch)
    make_films(command, capture, tmp_path / "there", "--cluster", cluster.scheduler_address)
    assert killed
    here, there = digests(tmp_path / "here"), digests(tmp_path / "there")
    assert len(here) == 2 * 2 * 3 + 2 * 2 + 2 * 4 + 1 + 2  # maps and clouds, meshes, videos and masks, preview, rows
    assert there == here
    assert not list(tmp_path.rglob(".*.part*"))


def test_a_task_on_a_cluster_uses_one_thread(cluster: LocalCluster) -> None:
    with open_pool(cluster=cluster.scheduler_address) as pool:
        assert list(pool.run([partial(numba.get_num_threads), partial(cv2.getNumThreads)])) == [1, 1]


def test_a_cluster_that_shares_a_bucket_and_no_folder_makes_the_same_files(
    command: Command, cluster: LocalCluster, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = ("--size", "96x64", "--seconds", 0.4, "--renderer", "software")
    one = ("--depth", "id", "--colour", "vertices", "--frames", "0:1")
    assert command("reconstruct", capture, "-o", tmp_path / "here", *one).code == 0
    assert command("render", tmp_path / "here", "-o", tmp_path / "here" / "set", *film).code == 0

    bucket, copies = f"s3://{BUCKET}", tmp_path / "copies"
    S3FileSystem().put(f"{capture}/", f"{bucket}/ball/", recursive=True)
    copies.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(copies))
    forget, address = partial(forget_copies, copies), cluster.scheduler_address
    options = ReconstructOptions(depths=("id",), frames=range(1), cluster=address)
    reconstruct(place(f"{bucket}/ball"), place(f"{bucket}/run"), options, forget)
    shown = RenderOptions(size=(96, 64), seconds=0.4, renderer="software", cluster=address)
    render([place(f"{bucket}/run")], place(f"{bucket}/run/set"), shown, forget)
    told = command("reconstruct", f"{bucket}/ball", "-o", f"{bucket}/run", *one, "--cluster", address)
    assert told.out.strip().endswith(f"): {bucket}/run"), told.err

    S3FileSystem().get(f"{bucket}/run/", str(tmp_path / "there") + "/", recursive=True)
    here, there = digests(tmp_path / "here"), digests(tmp_path / "there")
    assert there == here
    made = [json.loads(line)["made"] for line in (tmp_path / "there/log.jsonl").read_text().splitlines()]
    assert sorted(made) == sorted(name for name in here if not name.startswith(("set/", "previews/")))  # once each
    assert not (tmp_path / "there/set/.parts").exists()


def forget_copies(copies: Path, _what: str, done: int, _total: int) -> None:
    """Before each stage, remove the copies of what was made: what a task needs, it has to fetch."""
    for path in copies.rglob("*"):
        if done == 0 and path.is_file() and path.name != LOG_FILE:
            path.unlink()


def test_a_task_that_fails_is_tried_again_unless_its_input_is_wrong(cluster: LocalCluster, tmp_path: Path) -> None:
    (tmp_path / "flaky").mkdir()
    (tmp_path / "wrong").mkdir()
    with open_pool(cluster=cluster.scheduler_address) as pool:
        assert list(pool.run([partial(flaky, tmp_path / "flaky")])) == ["done"]
        with pytest.raises(ValueError, match="upside down"):
            list(pool.run([partial(wrong, tmp_path / "wrong")]))
    assert len(list((tmp_path / "wrong").iterdir())) == 1


def test_an_address_where_no_scheduler_is_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recon.runtime.workers.CONNECT_S", 1)
    with (
        pytest.raises(ValueError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9'"),
        open_pool(cluster="tcp://127.0.0.1:9"),
    ):
        pass


def test_a_scheduler_without_workers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recon.runtime.workers.CONNECT_S", 1)
    with (
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty,
        pytest.raises(ValueError, match="has no worker after 1 s; start some with `dask worker"),
        open_pool(cluster=empty.scheduler_address),
    ):
        pass
