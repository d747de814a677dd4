"""Films of every kind are shown right in a browser, or refused with a way out; none is accepted and shown wrong."""

from __future__ import annotations

import base64
import json
import re
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Page

from app.errors import StimuliError
from app.ffmpeg import decode
from app.ffmpeg.look import Look
from app.films.pairs import FilmMaker, PairVideo, prepare_alone, prepare_pairs
from app.films.strips import GUARD_ROWS
from app.intake.import_videos import import_stimuli
from app.intake.stimuli import read_manifest, read_stimulus_set
from app.intake.treatment import preview_of, treatment_of
from tests.app import tiny_stimuli

COLOURS = (
    ((128, 128, 128), (255, 255, 255), (0, 0, 0), (200, 60, 50)),
    ((60, 170, 60), (50, 60, 190), (180, 180, 60), (64, 64, 64)),
    ((60, 150, 160), (150, 70, 160), (32, 32, 32), (225, 190, 170)),
)
GREYS = tuple(
    tuple((level,) * 3 for level in row) for row in ((0, 30, 60, 90), (120, 140, 160, 180), (200, 220, 240, 255))
)
PATCH, N_FRAMES = 32, 4
WIDTH, HEIGHT = 4 * PATCH, 3 * PATCH
MOST_LEVELS = 3  # between a film and a lossless film of the truth in the same browser
MOST_LEVELS_OF_BROWSER = 7  # of its own conversion to RGB, seen in Chromium's blue even without loss
FFMPEG = imageio_ffmpeg.get_ffmpeg_exe()
FROM_RGB = "format=gbrp,zscale=min=gbr:rin=full:pin=bt709:tin=bt709:p=bt709:t=bt709:f=bicubic"
H264, PLAIN = "-c:v libx264 -qp 0", ":m=bt709:r=limited:p=bt709:t=bt709,format=yuv420p"
UNTAGGED = "setparams=colorspace=unknown:color_primaries=unknown:color_trc=unknown:range=unknown"
TAGGED = "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv"
HEVC, VP9 = "-c:v libx265 -x265-params lossless=1:log-level=none", "-c:v libvpx-vp9 -lossless 1"
AV1, PRORES = "-c:v libaom-av1 -crf 4 -cpu-used 8", "-c:v prores_ks -profile:v 3"
HDR_TAGS = "-colorspace bt2020nc -color_primaries bt2020 -color_range tv -color_trc"
PLAYED = """async ([film, rows, columns]) => {
  const bytes = Uint8Array.from(atob(film), (letter) => letter.charCodeAt(0));
  const video = Object.assign(document.createElement("video"), { muted: true });
  video.src = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
  await new Promise((resolve, reject) => {
    video.onerror = () => reject(video.error.message);
    video.requestVideoFrameCallback(resolve);
    video.play();
  });
  const { videoWidth: width, videoHeight: height } = video;
"""  # to its first frame
MEANS = (
    PLAYED
    + """  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(video, 0, 0);
  const mean = (x, y, w, h) => {
    const { data } = context.getImageData(x, y, w, h);
    return [0, 1, 2].map((channel) => data.filter((_, at) => at % 4 === channel).reduce((a, b) => a + b) / (w * h));
  };
  const [high, wide] = [height / rows, width / columns].map((side) => Math.floor(side));
  const inner = (row, column) => mean(column * wide + (wide >> 2), row * high + (high >> 2), wide >> 1, high >> 1);
  const means = [...Array(rows).keys()].map((row) => [...Array(columns).keys()].map((column) => inner(row, column)));
  return [width, height, means];
}"""
)  # of the inner half of each patch, red, green and blue


@dataclass(frozen=True)
class Case:
    """A film that is made for the test, and what must come of it.

    Parameters
    ----------
    chain : of filters, after FROM_RGB
    encoding : and its tags
    suffix : of the file
    refused : why and with which way out; empty: it is shown
    size : of what is shown, pixels
    turns : quarters by which the shown picture is turned, counterclockwise
    is_grey : are the patches grey?
    before : arguments of a second run, which copies the film
    """

    chain: str = PLAIN
    encoding: str = f"{H264} {TAGGED}"
    suffix: str = ".mp4"
    refused: str = ""
    size: tuple[int, int] = (WIDTH, HEIGHT)
    turns: int = 0
    is_grey: bool = False
    before: str = ""


def tagged(matrix: str, color_range: str = "tv", primaries: str = "bt709") -> str:
    return f"-colorspace {matrix} -color_range {color_range} -color_primaries {primaries} -color_trc bt709"


CASES: Mapping[str, Case] = {
    **{f"h264{suffix}": Case(suffix=suffix) for suffix in (".mp4", ".mov")},
    **{f"hevc{suffix}": Case(encoding=f"{HEVC} {TAGGED}", suffix=suffix) for suffix in (".mp4", ".mkv")},
    "vp9.webm": Case(encoding=f"{VP9} {TAGGED}", suffix=".webm"),
    "av1.mkv": Case(encoding=f"{AV1} {TAGGED}", suffix=".mkv"),
    "prores.mov": Case(f"{PLAIN.replace('yuv420p', 'yuv422p10le')}", encoding=f"{PRORES} {TAGGED}", suffix=".mov"),
    "601": Case(":m=smpte170m:r=limited,format=yuv420p", f"{H264} {tagged('smpte170m')}"),
    "untagged SD": Case(f":m=smpte170m:r=limited,format=yuv420p,{UNTAGGED}", H264),
    "untagged HD": Case(f"{PLAIN},{UNTAGGED},scale=1280:720:flags=neighbor", H264, size=(1280, 720)),
    "full range": Case(":m=bt709:r=full:p=bt709:t=bt709,format=yuv420p", f"{H264} {tagged('bt709', 'pc')}"),
    "240m": Case(":m=smpte240m:r=limited,format=yuv444p", f"{H264} {tagged('smpte240m')}"),
    "rgb": Case(",format=gbrp", "-c:v libx264rgb -qp 0", ".mkv"),
    "grey": Case(",format=gbrp,format=gray", "-c:v ffv1", ".mkv", is_grey=True),
    "10 bits, wide gamut": Case(
        ":m=2020_ncl:r=limited:p=bt2020:t=bt709,format=yuv420p10le", f"{H264} {tagged('bt2020nc', primaries='bt2020')}"
    ),
    "anamorphic": Case(f"{PLAIN},setsar=4/3", size=(170, HEIGHT)),
    "narrow pixels": Case(f"{PLAIN},setsar=8/9", size=(WIDTH, 108)),
    "rotated": Case(size=(HEIGHT, WIDTH), turns=1, before="-display_rotation 90"),
    "odd": Case(
        f"{PLAIN.replace('yuv420p', 'yuv444p')},crop=127:95:0:0:exact=1", f"-c:v libx264 -qp 0 {TAGGED}", size=(126, 94)
    ),
    "interlaced": Case(encoding=f"{H264} -flags +ilme+ildct -x264opts tff=1 {TAGGED}"),
    "sound": Case(encoding=f"-f lavfi -i sine=r=8000 -shortest -map 0:v -map 1:a {H264} {TAGGED}"),
    "PQ": Case(
        ":m=2020_ncl:r=limited:p=bt2020:t=smpte2084:npl=203,format=yuv420p10le",
        f"{H264} {HDR_TAGS} smpte2084",
        is_grey=True,
    ),
    "HLG": Case(
        ":m=2020_ncl:r=limited:p=bt2020:t=arib-std-b67:npl=203,format=yuv420p10le",
        f"{H264} {HDR_TAGS} arib-std-b67",
        is_grey=True,
    ),
    "PQ without a matrix": Case(
        ":m=2020_ncl:r=limited:p=bt2020:t=smpte2084:npl=203,format=yuv420p10le,setparams=colorspace=unknown"
        ":color_primaries=unknown",
        f"{H264} -color_range tv -color_trc smpte2084",
        is_grey=True,
    ),
    "transparent": Case(
        ":m=bt709:r=limited,format=yuva444p10le", "-c:v prores_ks -profile:v 4444", ".mov", "transparent parts.*`ffmpeg"
    ),
    "transparency beside the pictures": Case(
        ":m=bt709:r=limited,format=yuva420p", "-c:v libvpx-vp9", ".webm", "transparent parts.*`ffmpeg -c:v libvpx-vp9"
    ),
    "slanted": Case(refused="turned by 45 degrees.*`ffmpeg", before="-display_rotation 45", suffix=".mov"),
    "timecode": Case(encoding=f"{H264} {TAGGED} -timecode 01:00:00:00", suffix=".mov"),
    "png.mov": Case(",format=rgb24", "-c:v png", ".mov"),  # whose pictures name two transfers, shown alike
    "log": Case(f"{PLAIN},setparams=color_trc=log100", H264, refused="log100.*`ffmpeg"),
}


def write(case: Case, path: Path) -> None:
    """Encode the patches as a case wants it."""
    write_patches(np.array(GREYS if case.is_grey else COLOURS, np.uint8), path, case)


def write_patches(patches: NDArray[np.uint8], path: Path, case: Case) -> None:
    picture = patches.repeat(PATCH, axis=0).repeat(PATCH, axis=1)
    first = path if not case.before else path.with_name(f"first{path.suffix}")
    path.parent.mkdir(parents=True)
    arguments = f"-v error -y -f rawvideo -pix_fmt rgb24 -s {picture.shape[1]}x{picture.shape[0]} -r 25 -i -".split()
    encoding, sound = case.encoding.split(), []
    if "lavfi" in encoding:
        sound, encoding = encoding[:4], encoding[4:]
    command = [FFMPEG, *arguments, *sound, "-vf", FROM_RGB + case.chain, *encoding, str(first)]
    subprocess.run(command, input=picture.tobytes() * N_FRAMES, check=True)
    if case.before:
        turned = [FFMPEG, "-v", "error", *case.before.split(), "-i", str(first), "-c", "copy", str(path)]
        subprocess.run(turned, check=True)
        first.unlink()


def truth(name: str, case: Case) -> NDArray[np.float64]:
    """What the patches must look like, (3, 4, 3), turned as the film is."""
    patches = np.array(GREYS if case.is_grey else COLOURS, np.float64)
    if name.startswith(("PQ", "HLG")):
        patches = 255 * mobius((patches / 255) ** 2.4, peak=1000 / 203) ** (1 / 2.4)
    return np.rot90(patches, case.turns)


def mobius(light: NDArray[np.float64], *, peak: float, knee: float = 0.3) -> NDArray[np.float64]:
    """The tone mapping, by its formula: the identity up to the knee, then a Möbius curve to 1 at the peak."""
    a = -(knee**2) * (peak - 1) / (knee**2 - 2 * knee + peak)
    b = (knee**2 - 2 * knee * peak + peak) / (peak - 1)
    curve = (b**2 + 2 * b * knee + knee**2) / (b - a) * (light + a) / (light + b)
    return np.where(light <= knee, light, curve)


def shown(page: Page, film: Path, rows: int, columns: int) -> tuple[tuple[int, int], NDArray[np.float64]]:
    """The size of a film in the browser, and the mean of each patch, (rows, columns, 3)."""
    width, height, means = page.evaluate(MEANS, [base64.b64encode(film.read_bytes()).decode(), rows, columns])
    return (width, height), np.array(means)


@pytest.fixture(scope="module")
def page(browser: Browser) -> Iterator[Page]:
    page = browser.new_page()
    yield page
    page.close()


@pytest.fixture(scope="module")
def refusals() -> dict[str, str]:
    return {}


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory, refusals: dict[str, str]) -> dict[str, tuple[PairVideo, Path]]:
    """The film that participants are shown of each case that is taken."""
    folder = tmp_path_factory.mktemp("matrix")
    made = {}
    for name, case in CASES.items():
        write(case, folder / name / "set" / "scene" / f"film{case.suffix}")
        try:
            stimulus_set = import_stimuli(folder / name / "set", folder / name / "made").stimulus_set
        except StimuliError as error:
            refusals[name] = str(error)
            continue
        (film,) = prepare_alone(stimulus_set, FilmMaker(folder / name))
        made[name] = film, folder / name / film.file
    return made


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_film_is_shown_right_or_refused_with_a_way_out(
    films: dict[str, tuple[PairVideo, Path]], refusals: dict[str, str], page: Page, name: str, tmp_path: Path
) -> None:
    case = CASES[name]
    if case.refused:
        assert re.search(case.refused, refusals[name])
        return
    assert name not in refusals, refusals[name]
    film, path = films[name]
    assert (film.width, film.height) == case.size
    expected = truth(name, case)
    rows, columns = expected.shape[:2]
    size, seen = shown(page, path, rows, columns)
    assert size == case.size
    write_patches(expected.round().astype(np.uint8), tmp_path / "true" / "film.mp4", Case())
    _, true = shown(page, tmp_path / "true" / "film.mp4", rows, columns)
    assert np.abs(true - expected).max() <= MOST_LEVELS_OF_BROWSER
    assert np.abs(seen - true).max() <= MOST_LEVELS, np.abs(seen - true).max(axis=-1)


@pytest.mark.slow
def test_a_stimulus_alone_and_in_a_pair_has_the_same_colours(tmp_path: Path) -> None:
    case = Case(":m=smpte170m:r=full,format=yuv420p", f"{H264} {tagged('smpte170m', 'pc')}")
    for name in ("a", "b"):
        write(case, tmp_path / name / f"{name}.mp4")
    (tmp_path / "set" / "scene").mkdir(parents=True)
    for name in ("a", "b"):
        (tmp_path / name / f"{name}.mp4").rename(tmp_path / "set" / "scene" / f"{name}.mp4")
    made = import_stimuli(tmp_path / "set", tmp_path / "made").stimulus_set
    (alone, _), (pair,) = (make(made, FilmMaker(tmp_path)) for make in (prepare_alone, prepare_pairs))
    one, both = (tiny_stimuli.frames(tmp_path / film.file).astype(int) for film in (alone, pair))
    top, bottom = both[:, :HEIGHT], both[:, HEIGHT + GUARD_ROWS :]
    inner = (slice(None), slice(None, None), slice(None))
    assert np.abs(top - one)[inner].mean() < 0.5
    assert np.abs(bottom - one)[inner].mean() < 0.5


def test_what_was_found_and_done_stands_in_the_manifest(tmp_path: Path) -> None:
    film = tmp_path / "films" / "scene" / "wide.mp4"
    tiny_stimuli.encode(film, tiny_stimuli.flat("gray"), "-vf", "setsar=2/1,setparams=range=tv")
    made = import_stimuli(tmp_path / "films", tmp_path / "set")
    (entry,) = json.loads((tmp_path / "set" / "manifest.json").read_text(encoding="utf-8"))["stimuli"]
    assert entry["found"]["pixel_shape"] == "2:1"
    assert (entry["found"]["matrix"], entry["found"]["range"]) == ("unknown", "unknown")
    assert entry["found"]["read_as"] == {"matrix": "smpte170m", "range": "tv"}
    assert entry["done"] == ["scaled from 64x48 with pixels 2:1 to 128x48 with square pixels"]
    assert any(note.startswith("scene/wide: scaled from 64x48") for note in made.notes)
    assert decode(tmp_path / "set" / entry["video"]).pixel_shape == 1


def test_a_set_with_films_that_browsers_show_in_another_shape_is_refused(tmp_path: Path) -> None:
    for name in ("id_fa", "pm_fb"):
        tiny_stimuli.encode(tmp_path / "ball" / f"{name}.mp4", tiny_stimuli.flat("gray"), "-vf", "setsar=4/3")
    tiny_stimuli.write_manifest(
        tmp_path, [tiny_stimuli.stimulus(tmp_path, "ball", name) for name in ("id_fa", "pm_fb")]
    )
    with pytest.raises(StimuliError, match=r"not ready to be shown, as it must be scaled .* stimuli import"):
        read_stimulus_set(tmp_path)


def test_unlike_films_are_made_alike_where_it_is_asked_for(tmp_path: Path) -> None:
    folder = tmp_path / "films" / "scene"
    tiny_stimuli.encode(folder / "a.mp4", tiny_stimuli.flat("gray"))
    tiny_stimuli.encode(folder / "b.mp4", tiny_stimuli.flat("gray"))
    large = "color=gray:size=128x96:rate=50"
    tiny_stimuli.encode(folder / "large.mp4", large, "-frames:v", "24")
    with pytest.raises(
        StimuliError, match=r"expected 10 frames at 25/s of 64x48.*--conform.*fps=25,scale=64:48 -frames:v 10"
    ):
        import_stimuli(tmp_path / "films", tmp_path / "set")
    made = import_stimuli(tmp_path / "films", tmp_path / "set", is_conformed=True)
    assert {(s.width, s.height, s.fps, s.n_frames) for s in read_manifest(tmp_path / "set").stimuli} == {
        (64, 48, 25.0, 10)
    }
    (note,) = (note for note in made.notes if note.startswith("scene/large"))
    for done in ("rate changed from 50 to 25", "scaled from 128x96 to 64x48", "cut after 10 of 12"):
        assert done in note


def test_a_film_of_another_shape_is_refused_as_such_before_anybody_is_told_to_make_films_alike(tmp_path: Path) -> None:
    folder = tmp_path / "films" / "scene"
    tiny_stimuli.encode(folder / "a.mp4", tiny_stimuli.flat("gray"))
    tiny_stimuli.encode(folder / "b.mp4", tiny_stimuli.flat("gray"))
    tiny_stimuli.encode(folder / "wide.mp4", tiny_stimuli.flat("gray"), "-vf", "setsar=2")
    why = "wide.mp4: is shown as 128x48, another shape than the 64x48 of its scene's other films: cut it, or encode"
    for is_conformed in (False, True):
        with pytest.raises(StimuliError, match=why):
            import_stimuli(tmp_path / "films", tmp_path / "set", is_conformed=is_conformed)


@pytest.mark.parametrize(
    ("pixel_format", "bits"),
    [("yuv420p", 8), ("nv12", 8), ("yuv422p10le", 10), ("xv30le", 10), ("p012le", 12), ("gbrp16le", 16)],
)
def test_the_bits_of_a_sample_are_told_by_the_pixel_format(pixel_format: str, bits: int) -> None:
    assert Look("prores", 64, 48, pixel_format).bits == bits


def untagged(color_range: str) -> str:
    return f":m=bt709:r={color_range}:p=bt709:t=bt709,format=yuv422p10le,{UNTAGGED}"


@pytest.mark.slow
def test_a_film_without_its_range_is_asked_about_where_its_values_tell_that_the_range_matters(tmp_path: Path) -> None:
    for name in ("full", "limited"):
        write(Case(untagged(name), PRORES), tmp_path / name / "scene" / "film.mov")
    assert import_stimuli(tmp_path / "limited", tmp_path / "taken").stimulus_set.stimuli[0].n_frames == N_FRAMES
    with pytest.raises(StimuliError, match=r"does not say .* of its pixels .* `--range full`") as refused:
        import_stimuli(tmp_path / "full", tmp_path / "refused")
    assert "--" not in refused.value.on_page
    for said, black in (("full", 16), ("limited", 0)):
        made = import_stimuli(tmp_path / "full", tmp_path / f"as {said}", untagged_range=said).stimulus_set
        film = tmp_path / f"as {said}" / made.stimuli[0].video
        assert luma_of_black(film) == pytest.approx(black, abs=2)
        facts = decode(film)
        assert facts.look is not None
        assert facts.look.color_range == "tv"
        assert treatment_of(film, facts).done == ()  # asks nothing again


def test_a_film_without_its_range_is_limited_where_the_standard_of_its_codec_says_so(tmp_path: Path) -> None:
    write(Case(untagged("full"), H264), tmp_path / "films" / "scene" / "film.mp4")
    notes = import_stimuli(tmp_path / "films", tmp_path / "set").notes
    assert any("% of its pixels lie beyond the limited range" in note for note in notes)
    made = import_stimuli(tmp_path / "films", tmp_path / "full", untagged_range="full")
    assert luma_of_black(tmp_path / "full" / "scene" / "film.mp4") == pytest.approx(16, abs=2)
    assert not any("beyond" in note for note in made.notes)


def luma_of_black(film: Path) -> int:
    """The luma in the middle of the black patch."""
    command = [FFMPEG, "-v", "error", "-i", str(film), "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-"]
    raw = subprocess.run(command, check=True, capture_output=True).stdout
    return int(np.frombuffer(raw, np.uint8)[: WIDTH * HEIGHT].reshape(HEIGHT, WIDTH)[PATCH // 2, 5 * PATCH // 2])


@pytest.mark.slow
def test_a_preview_of_full_range_is_as_bright_as_the_film(tmp_path: Path) -> None:
    write(CASES["full range"], tmp_path / "full" / "film.mp4")
    assert luma_of_black(preview_of(tmp_path / "full" / "film.mp4", tmp_path / "stills")) == 16


def test_a_preview_has_the_shape_of_the_film_and_is_made_once(tmp_path: Path) -> None:
    film = tmp_path / "wide.mkv"
    tiny_stimuli.encode(
        film, tiny_stimuli.flat("gray"), "-c:v", "libx265", "-x265-params", "log-level=none", "-vf", "setsar=2"
    )
    preview = preview_of(film, tmp_path / "stills")
    facts = decode(preview)
    assert (facts.width, facts.height) == (128, 48)
    assert facts.pixel_shape == 1
    assert facts.look is not None
    assert facts.look.codec == "h264"
    made_at = preview.stat().st_mtime_ns
    assert preview_of(film, tmp_path / "stills").stat().st_mtime_ns == made_at
    film.write_bytes(b"no film")
    with pytest.raises(StimuliError, match=r"wide\.mkv: cannot be decoded"):
        preview_of(film, tmp_path / "stills")
