import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";

import { pass, settle, stopClock } from "./server.mjs";
import { onTrouble } from "../../../static/js/connection.js";
import { Films } from "../../../static/js/films.js";

const URL = "/media/pair.mp4";

let told;
let asked;

beforeEach(() => {
  stopClock();
  told = [];
  onTrouble((isInTrouble) => told.push(isInTrouble));
});
afterEach(() => {
  onTrouble(() => {});
  mock.timers.reset();
  mock.restoreAll();
});

/** Puts a server in place of `fetch` that answers each time with the next pieces: strings, or waits in ms, Infinity: no more. */
function send(...answers) {
  asked = [];
  globalThis.fetch = async (_url, { signal }) => {
    const pieces = answers[Math.min(asked.length, answers.length - 1)];
    asked.push(Date.now());
    const length = pieces.filter((piece) => typeof piece === "string").join("").length;
    const body = new ReadableStream({
      async start(controller) {
        signal.addEventListener("abort", () => controller.error(signal.reason));
        for (const piece of pieces) {
          if (piece === Infinity) return;
          if (typeof piece === "number") await new Promise((resolve) => setTimeout(resolve, piece));
          else controller.enqueue(new TextEncoder().encode(piece));
        }
        controller.close();
      },
    });
    return new Response(body, { headers: { "Content-Length": String(length), "Content-Type": "video/mp4" } });
  };
}

const text = async (film) => (await (await film.whole)[0].text());

test("a film on a line that falls silent is asked for again after half a minute, and the participant told", async () => {
  send(["half a ", Infinity, "film"], ["a whole film"]);
  const film = new Films().get([URL]);
  await pass(30_000);
  assert.deepEqual([asked, told], [[0], [true]]);
  await pass(250);
  assert.equal(await text(film), "a whole film");
  assert.deepEqual([asked, told], [[0, 30_250], [true, false]]);
});

test("a slow film is waited for as long as something of it comes", async () => {
  send(["a ", 29_000, "slow ", 29_000, "film"]);
  const film = new Films().get([URL]);
  await pass(59_000);
  assert.equal(await text(film), "a slow film");
  assert.deepEqual([asked, told], [[0], []]);
});

test("a film that is no longer wanted is not asked for again", async () => {
  send(["half a ", Infinity, "film"]);
  const films = new Films();
  const given_up = films.get([URL]).whole;
  await settle();
  films.stop();
  await assert.rejects(given_up, { name: "AbortError" });
  await pass(60_000);
  assert.deepEqual([asked, told], [[0], []]);
});
