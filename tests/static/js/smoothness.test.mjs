// How a film ran on the display, by the counts of a browser and the clocks of a page.

import assert from "node:assert/strict";
import test from "node:test";

import { Smoothness } from "../../../static/js/smoothness.js";

const FPS = 25;
const STEP_MS = 40;

/** A film that runs from one time to another on a display of 50 Hz. */
function run(smoothness, from_ms, to_ms, n_before, asleep_ms = 0) {
  let n = n_before;
  for (let at_ms = from_ms + STEP_MS / 2; at_ms <= to_ms; at_ms += STEP_MS / 2) {
    if ((at_ms - from_ms) % STEP_MS === 0) n += 1;
    smoothness.refresh(at_ms, n, at_ms + asleep_ms);
  }
  return n;
}

test("a film that runs has no gap but its own steps, and never stands still", () => {
  const smoothness = new Smoothness(FPS);
  smoothness.begin(0, 0);
  const n = run(smoothness, 0, 4000, 1);
  smoothness.end(4000, n, 4000);
  assert.deepEqual([smoothness.n_presented, smoothness.n_refreshes, smoothness.longest_gap_ms], [101, 200, STEP_MS]);
  assert.equal(smoothness.stillBetween(0, 4000), 0);
});

test("what a film stands still longer than a quarter of a second is no viewing", () => {
  const smoothness = new Smoothness(FPS);
  smoothness.begin(0, 0);
  const n = run(smoothness, 0, 1000, 1);
  const awake = run(smoothness, 16_000, 17_000, n);
  smoothness.end(17_000, awake, 17_000);
  assert.equal(smoothness.longest_gap_ms, 15_040);
  assert.equal(smoothness.stillBetween(0, 17_000), 15_040 - 250);
  assert.equal(smoothness.stillBetween(0, 1000), 0);
  assert.equal(smoothness.stillBetween(5000, 6000), 1000);
});

test("a sleep is a gap also where the page's own clock stands meanwhile", () => {
  const smoothness = new Smoothness(FPS);
  smoothness.begin(0, 0);
  const n = run(smoothness, 0, 1000, 1);
  assert.equal(smoothness.gap(1040, n + 1, 901_040), 900_040);
  assert.equal(smoothness.gap(1040, n + 1, 1500), 40, "a clock that was set by half a second is no sleep");
  assert.equal(smoothness.gap(1040, n + 1, -5000), 40, "nor is one that was set back");
});

test("frames that a busy page was not told of in time were on the display all the same", () => {
  const smoothness = new Smoothness(FPS);
  smoothness.begin(0, 0);
  smoothness.refresh(1600, 41, 1600);
  assert.equal(smoothness.longest_gap_ms, STEP_MS);
  assert.equal(smoothness.n_presented, 41);
  assert.equal(smoothness.stillBetween(0, 1600), 0);
});

test("an exposure's end is a gap, too, and the next exposure counts on", () => {
  const smoothness = new Smoothness(FPS);
  smoothness.begin(0, 0);
  smoothness.end(1500, 1, 1500);
  assert.equal(smoothness.longest_gap_ms, 1500);
  smoothness.begin(1500, 90_000);
  const n = run(smoothness, 1500, 2500, 1, 88_500);
  smoothness.end(2500, n, 91_000);
  assert.deepEqual([smoothness.longest_gap_ms, smoothness.n_presented], [1500, 27]);
});

test("a film of long steps does not stand still between them", () => {
  const smoothness = new Smoothness(1);
  smoothness.begin(0, 0);
  for (const [at_ms, n] of [[1000, 2], [2020, 3], [3000, 4]]) smoothness.refresh(at_ms, n, at_ms);
  assert.equal(smoothness.stillBetween(0, 3000), 0);
});
