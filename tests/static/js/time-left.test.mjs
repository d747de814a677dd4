// How long the study takes, as the page tells it.

import assert from "node:assert/strict";
import test from "node:test";

import { minutesLeft, minutesTogether, roughly } from "../../../static/js/time-left.js";

const MINUTES = { introduction: 1.5, screening: 4.2, trial: 20, interview: 2.2 };

test("all stages together take as long as the minutes announced of each", () => {
  assert.equal(minutesTogether(MINUTES), 28);
  for (const minutes of [{ introduction: 1.5, trial: 0.34 }, { introduction: 2.4, screening: 5.4, trial: 0.4 }]) {
    const announced = Object.values(minutes).map(roughly);
    assert.equal(minutesTogether(minutes), announced.reduce((sum, stage) => sum + stage));
  }
});

test("the time left shrinks with every trial and ends with the questions", () => {
  const left = [1, 6, 10].map((number) => minutesLeft(MINUTES, { number, total: 10 }));
  assert.deepEqual(left, [23, 13, 5]);
});

test("the last seconds are a minute, and a stage is never said to take none", () => {
  assert.equal(minutesLeft({ trial: 2 }, { number: 10, total: 10 }), 1);
  assert.deepEqual([roughly(), roughly(0.2), roughly(4.5)], [1, 1, 5]);
});
