from __future__ import annotations

import pytest

from app.study.trial.smoothness import UNKNOWN, allowed_gap_ms, smoothness

FPS = 25.0


def looked_at(**facts: object) -> dict[str, object]:
    """A look of four seconds, which a film without drops fills with 100 frames."""
    return {"first_shown": "a", "shown_ms": 4000.0, "switches": [], **facts}


def test_a_film_that_ran_supports_its_viewing() -> None:
    told = {"longest_gap_ms": 80.0, "n_presented": 98, "n_refreshes": 240}
    played = smoothness(looked_at(smoothness=told, n_mismatches=12), FPS)
    assert (played.longest_gap_ms, played.frame_share, played.mismatch_share) == (80.0, 0.98, 0.05)
    assert played.shown_smoothly is True


@pytest.mark.parametrize(
    "told",
    [
        {"longest_gap_ms": 1041.0, "n_presented": 74},  # enough frames, and one standstill
        {"longest_gap_ms": 300.0, "n_presented": 49},  # no standstill, and half of the frames are missing
        {"longest_gap_ms": 300.0, "n_presented": 99, "n_refreshes": 40},  # what was pressed was seen late
        {"longest_gap_ms": 1600.0},
    ],
)
def test_a_film_that_stood_still_or_lost_its_frames_does_not(told: dict[str, float]) -> None:
    assert smoothness(looked_at(smoothness=told), FPS).shown_smoothly is False


def test_pictures_that_came_late_after_presses_do_not_either() -> None:
    told = {"longest_gap_ms": 366.7, "n_presented": 90, "n_refreshes": 60}
    for delays, is_smooth in (((30.0, 240.0, 900.0), True), ((30.0, 725.0, 900.0), False)):
        switches = [{"to": "b", "at_ms": 10.0, "presented_ms": 10.0 + delay} for delay in delays]
        assert smoothness(looked_at(smoothness=told, switches=switches), FPS).shown_smoothly is is_smooth


def test_a_computer_that_slept_is_found_in_records_from_before_gaps_were_recorded() -> None:
    slept = looked_at(shown_ms=15_915.0, n_frames=28, n_dropped=0, n_stalls=0)
    played = smoothness(slept, FPS)
    assert (played.longest_gap_ms, played.frame_share, played.shown_smoothly) == (None, 0.0704, False)
    assert smoothness(looked_at(n_frames=100, n_dropped=2), FPS).shown_smoothly is True


def test_two_videos_counted_the_frames_of_both() -> None:
    viewing = looked_at(technique="two videos", switches=[{"to": "b", "at_ms": 10.0}], n_frames=90, n_dropped=0)
    assert smoothness(viewing, FPS).frame_share == 0.45


@pytest.mark.parametrize("viewing", [None, {}, looked_at(), looked_at(n_frames=0)])
def test_what_was_not_recorded_is_not_judged(viewing: dict[str, object] | None) -> None:
    assert smoothness(viewing, FPS) == UNKNOWN


def test_the_steps_of_a_slow_film_are_no_gaps() -> None:
    assert allowed_gap_ms(1.0) == 2000.0
    assert allowed_gap_ms(25.0) == 1040.0
