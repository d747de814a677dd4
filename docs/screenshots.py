"""Pictures of the dashboard: `python docs/screenshots.py DEMO` after `reconstudy demo --out DEMO --no-serve`.

A server of its own gets a study of the demo's videos, simulated participants, the demo's models, and the demo's report
on its films, and those given with --report. Chromium then photographs the pages that the documentation shows into
docs/pictures; --all DIR instead writes every page at three widths, to be looked at.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import httpx
import numpy as np
from playwright.sync_api import Page, sync_playwright

from app.experiment.demo import MEASURES
from app.experiment.study import TRUTH
from app.main import running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.participants import begin, next_trial, simulate_study, vote
from app.study.options.options import StudyOptions

PICTURES = Path(__file__).parent / "pictures"
SIZES = {"laptop": (1366, 768), "screen": (1920, 1080), "telephone": (390, 844)}
SHOWN = {  # of the documentation: page -> what is scrolled to, if not its beginning
    "studies/demo": None,
    "studies/demo/results": "#figures",
    "studies/demo/models": "#models-form",
    "studies/demo/objective/scores": None,
    "studies/demo/votes/TRIAL": ".replay",
}
PAGES = (
    *("", "studies/new", "sets", "users", "tokens", "audit", "settings", "account", "studies/demo"),
    *(
        f"studies/demo/{name}"
        for name in (
            *("results", "objective", "objective/scores", "models", "participants", "participants/P001"),
            *("participants/comments", "participants/demographics", "invitations/print"),
            *("participants/P001/interview", "votes", "votes/TRIAL", "design", "stimuli", "invitations", "edit"),
        )
    ),
)
QUALITY = 82  # of WebP; pages stay under 100 kB
SETTLED_MS = 1500  # figures and models are drawn


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stimuli", type=Path, help="the demo's folder, or that of a stimulus set")
    parser.add_argument("--models", type=Path, help="as `reconstudy models` wrote them; default: of the demo's run")
    parser.add_argument("--report", type=Path, action="append", default=[], help="of `reconstudy validate`")
    parser.add_argument("--all", type=Path, metavar="DIR", help="every page at three widths")
    given = parser.parse_args()
    names = PAGES if given.all else SHOWN
    with (
        tempfile.TemporaryDirectory() as folder,
        study_server(given, Path(folder)) as (url, path, trial),
        experimenter(url, path) as page,
    ):
        for width, size in SIZES.items() if given.all else [("", SIZES["laptop"])]:
            page.set_viewport_size({"width": size[0], "height": size[1]})
            for name in names:
                picture = photograph(page, name, trial, is_whole=bool(given.all))
                out = given.all or PICTURES
                write(out / f"{'-'.join(filter(None, (name.replace('/', '-') or 'all', width)))}.webp", picture)


@contextmanager
def study_server(given: argparse.Namespace, folder: Path) -> Iterator[tuple[str, str, str]]:
    """A server with a study that people take; its address, a sign-in link's path and a trial that was voted on."""
    settings = Settings(data_dir=folder)
    demo = (given.stimuli / "run" / "run.json").is_file()
    stimuli = given.stimuli / "stimuli" if demo else given.stimuli
    shutil.copytree(stimuli, settings.sets_dir / "demo")
    options = StudyOptions(optional_stages=("interview",), debriefing="Thank you.", without=(TRUTH,) if demo else ())
    create.create_study(settings, stimuli, "Demo", exposure_s=2.0, seed=1, options=options)
    with running_server(settings) as url:
        simulate_study(settings, url, "demo", 12, None, 0.15, 1)
        leave_in_the_middle(settings, url)
        if demo:
            manage.attach_results(settings, [given.stimuli / "validation" / "films"], "demo", only=MEASURES)
        attached = [*given.report, *models(given, folder, is_demo=demo)]
        if attached:
            manage.attach_results(settings, attached, "demo")
        with manage.own_token(settings, "screenshots") as token:
            bearer = {"Authorization": f"Bearer {token}"}
            trials = httpx.get(f"{url}/api/v1/studies/demo/trials", headers=bearer, timeout=60).json()
        looked = max(trials, key=lambda row: row["n_switches"] or 0)
        yield url, manage.add_experimenter(settings, "Ada Example")["path"], str(looked["trial"])


def leave_in_the_middle(settings: Settings, url: str) -> None:
    """Somebody who is still there."""
    invitation = manage.add_invitation(settings, "demo")["invitation"]
    with httpx.Client(base_url=url, timeout=60) as client:
        session = begin(client, "demo", invitation)
        for choice in ("a", "none", "b"):
            trial = next_trial(client, session["token"])
            if trial is not None:
                vote(client, session["token"], trial, choice, np.random.default_rng(1))


def models(given: argparse.Namespace, folder: Path, *, is_demo: bool) -> Sequence[Path]:
    if given.models:
        return [given.models]
    if not is_demo:
        return []
    from recon.validation.export_models import write_models

    write_models([given.stimuli / "run"], folder / "gathered", None, lambda *_: None)
    return [folder / "gathered"]


@contextmanager
def experimenter(url: str, path: str) -> Iterator[Page]:
    """A signed-in experimenter's page, with WebGL drawn by the processor."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page(base_url=url)
        page.set_default_timeout(120_000)  # the first results load the analysis
        page.goto(path)
        page.get_by_role("button", name="Sign in").click()
        page.wait_for_url("**/admin")
        page.goto("/admin/account")  # a password, so that no page asks for one
        for name in ("password", "again"):
            page.locator(f"[name={name}]").fill("seven quiet herons")
        page.get_by_role("button", name="Save").click()
        page.get_by_role("heading", name="Change the password").wait_for()
        yield page
        browser.close()


def photograph(page: Page, name: str, trial: str, *, is_whole: bool) -> bytes:
    page.goto(f"/admin/{name.replace('TRIAL', trial)}")
    colours = page.locator("#models-form [name=colours]")
    if colours.count():
        colours.select_option("error")
    if not is_whole and (place := SHOWN[name]):
        page.locator(place).scroll_into_view_if_needed()
    page.wait_for_timeout(SETTLED_MS)
    return page.screenshot(full_page=is_whole)


def write(path: Path, picture: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    path.write_bytes(cv2.imencode(".webp", pixels, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes())
    print(f"{path}: {path.stat().st_size // 1024} kB")


if __name__ == "__main__":
    main()
