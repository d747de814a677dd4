// The record of how a pair was looked at.

import assert from "node:assert/strict";
import test from "node:test";

import { ViewingRecord } from "../../../static/js/viewing.js";

const DAY_MS = 24 * 3600 * 1000; // the server takes no time farther away

test("what happened before a break over a weekend is in the record, within the times that the server takes", () => {
  globalThis.window = { innerWidth: 1280, innerHeight: 720, devicePixelRatio: 1 };
  globalThis.document = { fullscreenElement: null };
  const happened = [
    { what: "hidden", at_ms: 1000 },
    { what: "visible", at_ms: 3 * DAY_MS },
  ];
  const record = new ViewingRecord({ first_shown: "a", media: { fps: 25 } }, { happened });
  record.begin(3 * DAY_MS + 500);
  assert.deepEqual(
    record.viewing.happened.map(({ at_ms }) => at_ms),
    [-DAY_MS, -500],
  );
});
