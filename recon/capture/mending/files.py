"""The files of a recording at a second place."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from recon.capture.format import Capture, depth_path, expected_pictures, write_capture
from recon.capture.schema import Draft
from recon.runtime.files import new_folder
from recon.runtime.remote import fetched


def copied(capture: Capture, out: Path) -> Capture:
    """Write a recording, which may have been changed in memory, with all its files into a new folder.

    Parameters
    ----------
    capture : the recording
    out : the folder, absent or empty
    """
    cameras = tuple(camera for stream in capture.sensors for camera in stream.cameras)
    draft = Draft(capture, capture.n_frames, capture.bounds, cameras, capture.sensors, capture.held_out)
    paths = [picture.path for picture in expected_pictures(capture.folder, draft)]
    for stream in capture.sensors:
        paths += [depth_path(capture.folder, stream.depth, frame) for frame in range(capture.n_frames) if stream.depth]
    with new_folder(out) as folder:
        for path in dict.fromkeys(paths):
            link(path, folder / path.relative_to(capture.folder))
        write_capture(replace(capture, folder=folder))
    return replace(capture, folder=out)


def link(source: Path, target: Path) -> None:
    """Let a file stand at a second place, without its bytes being copied where the disk allows that."""
    target.parent.mkdir(parents=True, exist_ok=True)
    source = fetched(source)
    with suppress(OSError):
        os.link(source, target)
        return
    shutil.copyfile(source, target)
