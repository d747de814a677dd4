import assert from "node:assert/strict";
import { test } from "node:test";

import { erased, extended } from "../../../static/js/stroke-lines.js";

const LINE = { label: "foreground", points: [[0, 10], [100, 10]], width: 4 };

test("an eraser that crosses a line leaves two pieces, however fast it moves", () => {
  const pieces = erased([LINE], [50, -200], [50, 200], 3);
  assert.deepEqual(pieces.map(({ points }) => [points.at(0), points.at(-1)].map(([x]) => Math.sign(x - 50))), [[-1, -1], [1, 1]]);
  assert.ok(pieces.every(({ points }) => points.every(([x, y]) => Math.abs(x - 50) > 5 && y === 10)));
  assert.ok(pieces.every(({ label, width }) => label === "foreground" && width === 4));
});

test("an eraser leaves what it does not touch as it is, and nothing of what it covers", () => {
  assert.deepEqual(erased([LINE], [50, 30], [50, 40], 3), [LINE]);
  assert.deepEqual(erased([LINE], [0, 10], [100, 10], 3), []);
});

test("a line takes no second point almost where the last one is", () => {
  assert.deepEqual(extended([[5, 5]], [6, 5]), [[5, 5]]);
  assert.deepEqual(extended([[5, 5]], [9, 5]), [[5, 5], [9, 5]]);
});
