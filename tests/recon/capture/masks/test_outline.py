from __future__ import annotations

import cv2
import numpy as np

from recon.capture.masks.evidence import evidence_of
from recon.capture.masks.outline import KEPT, grown, hides_plate, likeness, tightened, without_lit_background

SIZE = (120, 160)


def disc(radius: int) -> np.ndarray:
    return np.asarray(cv2.circle(np.zeros(SIZE, dtype=np.uint8), (80, 60), radius, 1, -1) > 0)


def speckled_floor() -> np.ndarray:
    rng = np.random.default_rng(0)
    grey = 110 + 25 * cv2.GaussianBlur(rng.normal(0, 3, SIZE), (0, 0), 1.5)
    return np.repeat(grey[..., None], 3, axis=2).clip(0, 255)


def test_a_blurred_edge_is_put_where_half_of_the_evidence_is_left() -> None:
    exact = disc(28)
    evidence = cv2.GaussianBlur(exact.astype(np.float32) * 200, (0, 0), 1.2)
    wide = evidence > 10
    tight = tightened(wide, np.asarray(evidence, dtype=np.float32))
    assert (wide & ~exact).sum() > 100
    assert (tight ^ exact).sum() < 20


def test_a_cloth_that_stray_light_falls_on_does_not_belong_to_the_object_before_it() -> None:
    exact = disc(28)
    glow = cv2.GaussianBlur(exact.astype(np.float32) * 45, (0, 0), 5)
    brightness = np.asarray(45 + cv2.GaussianBlur(exact.astype(np.float32) * 170, (0, 0), 1.2) + glow * ~exact)
    wide = brightness > 50
    tight = without_lit_background(wide, brightness, 50.0)
    assert (wide & ~exact).sum() > 1000
    assert (tight ^ exact).sum() < 60  # of 176 along the outline


def test_a_dark_part_before_a_black_background_stays_whole() -> None:
    brightness = np.where(disc(28), np.float32(200), np.float32(3)) * np.where(np.arange(SIZE[1]) < 60, 0.2, 1)
    kept = without_lit_background(disc(28), brightness.astype(np.float32), 50.0)
    assert (kept == disc(28)).all()


def test_a_shadow_keeps_the_floors_pattern_and_trousers_of_its_colour_do_not() -> None:
    floor = speckled_floor()
    noise = np.random.default_rng(1).normal(0, 0.3, floor.shape)
    shade = 1 - 0.3 * cv2.GaussianBlur(disc(30).astype(np.float64), (0, 0), 6)[..., None]
    shadow, trousers = floor * shade + noise, np.where(disc(30)[..., None], (80.0, 77.0, 74.0), floor) + noise
    for picture, at_least, at_most in ((shadow, 0.0, 0.02), (trousers, 0.8, 1.0)):
        picture, plate = picture.astype(np.float32), floor.astype(np.float32)
        evidence, changed = evidence_of(picture, plate), np.abs(picture - plate).max(axis=2) > 5
        found = hides_plate(picture, plate, evidence > 2.5, changed)
        assert at_least <= (found & disc(30)).sum() / disc(30).sum() <= at_most
        assert not (found & ~disc(33)).any()


def test_the_floor_between_two_legs_keeps_its_pattern_in_their_shadow() -> None:
    floor = speckled_floor()
    legs = disc(30) & ~(np.abs(np.arange(SIZE[1]) - SIZE[1] // 2) < 5)
    between = disc(30) & ~legs
    shadow = floor * np.where(between, 0.5, 1.0)[..., None]
    picture = np.where(legs[..., None], 77.0, shadow) + np.random.default_rng(1).normal(0, 0.3, floor.shape)
    alike = likeness(picture.astype(np.float32), floor.astype(np.float32), legs, disc(30))
    assert (alike[between] > KEPT).mean() > 0.7


def test_grabcut_adds_doubtful_pixels_of_the_objects_colour_only() -> None:
    rng = np.random.default_rng(2)
    picture = np.full((*SIZE, 3), (90, 110, 60), dtype=np.float64)
    picture[disc(30)] = (60, 80, 180)
    noisy = (picture + rng.normal(0, 4, picture.shape)).clip(0, 255).astype(np.uint8)
    found = grown(noisy, disc(28), disc(36))
    assert (found ^ disc(30)).sum() < 30
