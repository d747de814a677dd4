// What the page knows of the frames on screen.

import assert from "node:assert/strict";
import test from "node:test";

import { followFrames, readiness } from "../../../static/js/playback.js";

/** A film of 0.8 s whose element gives one frame after another, at the times that a browser tells. */
class Film {
  duration = 0.8;
  requestVideoFrameCallback(callback) {
    this.give = (mediaTime) => callback(0, { mediaTime });
  }
}

test("a frame's time is one of its film, also in a browser that counts on when the film begins again", () => {
  const film = new Film();
  const told = [];
  followFrames(film, new AbortController().signal, (time_s) => told.push(time_s));
  for (const time_s of [0, 0.76, 0.8, 0.92, 2.4, 3.16]) film.give(time_s);
  assert.deepEqual(told, [0, 0.76, 0, 0.12, 0, 0.76]);
});

test("no frame is followed after the exposure", () => {
  const film = new Film();
  const told = [];
  const exposure = new AbortController();
  followFrames(film, exposure.signal, (time_s) => told.push(time_s));
  film.give(0);
  exposure.abort();
  film.requestVideoFrameCallback = () => assert.fail("asked for another frame");
  film.give(0.04);
  assert.deepEqual(told, [0, 0.04]);
});

test("a film is ready when it can play: WebKit says of none that stands still that it can play through", async () => {
  const film = new EventTarget();
  const ready = readiness(film, new AbortController().signal);
  film.dispatchEvent(new Event("canplay"));
  await ready;
});
