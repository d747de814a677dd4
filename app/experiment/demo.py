"""Make the demo's study of its videos, with the votes of simulated participants, its analysis and its front page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.analysis import write_analysis
from app.experiment.reconstruction.scale import SCALES
from app.experiment.study import TRUTH, fetched
from app.ffmpeg import Progress
from app.files import read_json, write_bytes, write_json
from app.intake.stimuli import MANIFEST
from app.operations.studies.create import create_study, read_options
from app.operations.studies.manage import add_experimenter, attach_results, list_studies
from app.settings import Settings
from app.simulation.known_order import came_out, came_out_sentence, outcome, put_in_sentence
from app.simulation.participants import simulate_study
from app.study.kinds import QUICK
from app.study.stages import PRACTICE
from app.web.participant.front import FRONT_FILE

NAME, SLUG = "Demo", "demo"
DEPTHS, FUSIONS = ("id", "dr", "pm"), ("fa", "fb")
APPROACHES = [f"{depth}_{fusion}_photographs" for depth in DEPTHS for fusion in FUSIONS]
TIE_RATE = 0.2
SEED = 1
PUT_IN_FILE = "put_in.json"  # what the simulated participants prefer
MEASURES = ("ssim_actor", "vmaf", "flicker")  # of the films, those that are compared with the scores


def demo_study(settings: Settings, manifest: Path, report: Path, exposure_s: float, progress: Progress) -> None:
    """Create the demo's study of all but the truth, with what was measured of its films, if it is not there."""
    if SLUG not in {study["slug"] for study in list_studies(settings)}:
        options = read_options(None, {"without": [TRUTH], "fallback": ""}, QUICK).with_stage(PRACTICE)
        create_study(settings, manifest, NAME, exposure_s=exposure_s, seed=SEED, options=options, progress=progress)
        attach_results(settings, [report], SLUG, only=MEASURES)


def demo_votes(settings: Settings, url: str, participants: int, out: Path, progress: Progress) -> None:
    """Let simulated participants vote; where some have, as a start was stopped, those who are left.

    They prefer what was measured to be more like the truth; what that is is noted in the demo's folder.
    """
    n_before = _study(settings)["n_finished"]
    if (n_left := participants - n_before) > 0:
        seed = SEED + n_before
        voted = simulate_study(settings, url, SLUG, n_left, None, TIE_RATE, seed, progress=progress)
        write_json(out / PUT_IN_FILE, {name: voted[name] for name in ("put_in", "order")})


def demo_analysis(settings: Settings, url: str, out: Path) -> None:
    """Fetch the study's analysis over REST and write it into a folder, once there are votes."""
    if _study(settings)["n_votes"]:
        analysis = fetched(settings, url, SLUG, ("analysis",))["analysis"]
        write_analysis(analysis, out, source="the demo's study")


def demo_front(settings: Settings, out: Path, folder: Path, n_frames: int) -> dict[str, Any]:
    """Write the front page's content; returns the paths of its links.

    Parameters
    ----------
    out : the demo's folder
    folder : the front page's folder, with the pictures of the stages
    n_frames : of the recording
    """
    study = _study(settings)
    paths = {
        "participant": f"/s/{study['invitations'][0]}",
        "experimenter": add_experimenter(settings, "demo")["path"],
    }
    for chart in (out / "analysis" / "figures" / f"{name}.svg" for name in ("scores", "measures")):
        if chart.is_file():
            write_bytes(folder / chart.name, chart.read_bytes())
    made = sorted(path.stem for path in folder.glob("*.webp"))
    pictures = {
        "recording": [name for name in made if name.startswith("recording_")],
        "depth": [f"depth_{method}" for method in DEPTHS],
        "model": [f"model_{approach}" for approach in APPROACHES],
    }
    content = {
        **paths,
        "n_pairs": study["n_pairs"],
        "exposure_s": study["exposure_s"],
        "n_votes": study["n_votes"],
        "n_participants": study["n_finished"],
        "n_frames": n_frames,
        "known": _put_in_and_came_out(out),
        "folder": out.name,
        "experiment_minutes": round(60 * SCALES["small"].hours),
        "pictures": pictures,
        "previews": sorted(path.name for path in (out / "run" / "previews").glob("*.png")),
        "films": [film["video"] for film in read_json(out / "stimuli" / MANIFEST)["stimuli"]],
    }
    write_json(folder / FRONT_FILE, content)
    return paths


def demo_scores(out: Path) -> Mapping[str, Any] | None:
    """Read the analysis; None before the first vote."""
    path = out / "analysis" / "analysis.json"
    return read_json(path) if path.is_file() else None


def demo_put_in(out: Path) -> list[str]:
    """Say what the simulated participants prefer, and what came out; nothing where it was not noted."""
    if (known := _put_in_and_came_out(out)) is None:
        return []
    return [put_in_sentence(known["put_in"], known["order"]), came_out_sentence(known["put_in"], known["came_out"])]


def _put_in_and_came_out(out: Path) -> dict[str, Any] | None:
    path, analysis = out / PUT_IN_FILE, demo_scores(out)
    if not path.is_file() or analysis is None:
        return None
    noted, scores = read_json(path), came_out(analysis)
    return noted | {"came_out": scores, "outcome": outcome(noted["put_in"], scores)}


def _study(settings: Settings) -> dict[str, Any]:
    """Return the demo's study; others may stand beside it by now."""
    return next(study for study in list_studies(settings) if study["slug"] == SLUG)
