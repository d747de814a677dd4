import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";

import { settle } from "./server.mjs";
import { Keeper } from "../../../static/js/stroke-keeper.js";

let sent, answers, keeper;

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout"] });
  Object.assign(window, { setTimeout, clearTimeout });
  sent = [];
  answers = [];
  keeper = new Keeper((place) => {
    sent.push(place);
    return new Promise((resolve, reject) => answers.push({ resolve, reject }));
  });
});
afterEach(() => mock.timers.reset());

const pass = async (milliseconds) => {
  mock.timers.tick(milliseconds);
  await settle();
};

test("changes that follow each other are sent once, half a second after the last", async () => {
  keeper.soon("frame-1");
  await pass(400);
  keeper.soon("frame-1");
  await pass(400);
  assert.deepEqual(sent, []);
  await pass(100);
  assert.deepEqual(sent, ["frame-1"]);
});

test("a newer drawing is sent only when the older one has been answered, and is lacking until then", async () => {
  keeper.soon("frame-1");
  await pass(500);
  keeper.soon("frame-1");
  await pass(60_000);
  assert.deepEqual(sent, ["frame-1"]);
  answers[0].resolve(true);
  await settle();
  assert.deepEqual(sent, ["frame-1", "frame-1"]);
  assert.equal(keeper.lacks("frame-1"), true);
  answers[1].resolve(true);
  await settle();
  assert.equal(keeper.isDone, true);
});

test("what is under way is not done yet", async () => {
  keeper.soon("frame-1");
  await pass(500);
  assert.equal(keeper.isDone, false);
  answers[0].resolve(true);
  await settle();
  assert.equal(keeper.isDone, true);
});

test("a drawing is sent again after the server could not be reached, and not after it refused", async () => {
  keeper.soon("frame-1");
  const first = keeper.now("frame-1");
  await settle();
  answers[0].reject(new TypeError("Failed to fetch"));
  assert.equal(await first, false);
  assert.equal(keeper.isDone, false);
  await pass(5000);
  assert.equal(sent.length, 2);
  answers[1].resolve(false);
  await settle();
  assert.equal(keeper.isDone, true);
  await pass(60_000);
  assert.equal(sent.length, 2);
});
