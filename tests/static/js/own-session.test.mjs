/** What a browser remembers of a session goes on where the page was left. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { OwnSession } from "../../../static/js/own-session.js";

const shelf = /** @type {import("../../../static/js/outbox.js").Shelf} */ (/** @type {unknown} */ ({ all: async () => [] }));

test("a break during which the page was left goes on, and the next one is a new one", () => {
  assert.equal(new OwnSession(shelf, "break").rested_s(25), Infinity);
  new OwnSession(shelf, "break").rest(25, 12);
  assert.equal(new OwnSession(shelf, "break").rested_s(25), 12);
  assert.equal(new OwnSession(shelf, "break").rested_s(50), Infinity);
});

test("what one session has agreed to and read is not another's", () => {
  const first = new OwnSession(shelf, "first");
  first.agreedText = "9f86";
  first.instructions = 3;
  first.lighten();
  const again = new OwnSession(shelf, "first");
  assert.deepEqual([again.agreedText, again.instructions, again.isLighter], ["9f86", 3, true]);
  const second = new OwnSession(shelf, "second");
  assert.deepEqual([second.agreedText, second.instructions, second.isLighter], [null, 0, false]);
});
