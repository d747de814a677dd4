import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";

import { pass, serve, settle, stopClock } from "./server.mjs";
import { onTrouble } from "../../../static/js/connection.js";
import { Outbox, newId, openShelf } from "../../../static/js/outbox.js";

const LOST = new TypeError("Failed to fetch");
const OWNER = "session-1";

let shelf;
let outbox;

beforeEach(async () => {
  stopClock();
  shelf = await openShelf(); // in memory: node has no IndexedDB
  outbox = new Outbox(shelf, OWNER);
});
afterEach(async () => {
  onTrouble(() => {});
  serve(200);
  window.dispatchEvent(new Event("online")); // ends what is still tried
  await settle();
  mock.timers.reset();
  mock.restoreAll();
});

const vote = (choice = "a") => ({ id: newId(), choice, viewing: { switches: [] } });
const waiting = async (owner = OWNER) => (await shelf.list(owner)).map((pending) => pending.trial);

test("a vote is kept before it is sent, and forgotten when the server has it", async () => {
  const requests = serve(200);
  const slow = { ...shelf, add: async (pending) => shelf.add(await settle().then(() => pending)) };
  await new Outbox(slow, OWNER).putVote("trial-1", vote());
  assert.deepEqual(await waiting(), ["trial-1"]);
  await settle();
  assert.deepEqual(await waiting(), []);
  assert.deepEqual(requests.map(({ method, url }) => `${method} ${url}`), ["PUT /api/v1/session/trials/trial-1/vote"]);
});

test("a vote stays, and is sent again with the same id and content, until the server acknowledges it", async () => {
  const requests = serve(LOST, 500, 503, 429, 408, 425, [200, '{"half an ans'], 200);
  const given = vote("none");
  await outbox.putVote("trial-1", given);
  for (let tries = 1; tries < 8; tries += 1) {
    await settle();
    assert.equal(requests.length, tries);
    assert.deepEqual(await waiting(), ["trial-1"]);
    await pass(250 * 2 ** (tries - 1));
  }
  assert.deepEqual(await waiting(), []);
  assert.deepEqual(requests.map(({ sent }) => sent), Array(8).fill(given));
});

test("the waits between tries double from a quarter of a second to half a minute", async () => {
  const requests = serve(LOST);
  await outbox.putVote("trial-1", vote());
  await pass(150_000);
  const waits = requests.slice(1).map(({ at }, index) => at - requests[index].at);
  assert.deepEqual(waits.slice(0, 10), [250, 500, 1000, 2000, 4000, 8000, 16_000, 30_000, 30_000, 30_000]);
});

test("a vote is sent at once when the browser is online again", async () => {
  const requests = serve(LOST, LOST, LOST, LOST, LOST, LOST, LOST, 200);
  await outbox.putVote("trial-1", vote());
  await pass(20_000);
  assert.equal(requests.length, 7);
  window.dispatchEvent(new Event("online"));
  await settle();
  assert.deepEqual(await waiting(), []);
});

test("trouble is told once when it begins and once when it ends", async () => {
  const told = [];
  onTrouble((isInTrouble) => told.push(isInTrouble));
  serve(LOST, 503, 200);
  await outbox.putVote("trial-1", vote());
  await pass(10_000);
  assert.deepEqual(told, [true, false]);
});

test("a vote is sent again when the server has not answered within half a minute", async () => {
  const asked = [];
  mock.method(AbortSignal, "timeout", (milliseconds) => {
    const stopping = new AbortController();
    setTimeout(() => stopping.abort(new DOMException("it took too long", "TimeoutError")), milliseconds);
    return stopping.signal;
  });
  globalThis.fetch = (_url, { signal }) =>
    new Promise((_resolve, reject) => {
      asked.push(Date.now());
      signal.addEventListener("abort", () => reject(signal.reason));
    });
  const told = [];
  onTrouble((isInTrouble) => told.push(isInTrouble));
  await outbox.putVote("trial-1", vote());
  await pass(30_250);
  assert.deepEqual([asked, told], [[0, 30_250], [true]]);
  assert.deepEqual(await waiting(), ["trial-1"]);
  serve(200);
  await pass(31_000);
  assert.deepEqual([await waiting(), told], [[], [true, false]]);
});

for (const status of [409, 422]) {
  test(`a vote that can never be taken (${status}) is sent once, and does not hold up the next`, async () => {
    const complaints = mock.method(console, "error", () => {});
    const requests = serve(status, 200);
    await outbox.putVote("trial-1", vote());
    await outbox.putVote("trial-2", vote());
    await outbox.emptied();
    await pass(60_000);
    assert.deepEqual(requests.map(({ url }) => url.split("/").at(-2)), ["trial-1", "trial-2"]);
    assert.deepEqual(await waiting(), []);
    assert.equal(complaints.mock.callCount(), status === 422 ? 1 : 0); // a lost vote is told to the console
  });
}

for (const status of [400, 401, 403, 404, 410, 413]) {
  test(`a refusal that may be lifted (${status}) is told, and the vote waits for the next call`, async () => {
    const requests = serve(status, status, 200);
    await outbox.putVote("trial-1", vote());
    await assert.rejects(outbox.emptied(), { status });
    assert.deepEqual(await waiting(), ["trial-1"]);
    await pass(60_000);
    assert.equal(requests.length, 2); // nothing is retried by itself
    await outbox.emptied();
    assert.deepEqual(await waiting(), []);
  });
}

test("votes leave one at a time, in the order in which they were given", async () => {
  let underWay = 0;
  const arrived = [];
  globalThis.fetch = async (url) => {
    underWay += 1;
    assert.equal(underWay, 1);
    await settle();
    underWay -= 1;
    arrived.push(url.split("/").at(-2));
    return new Response("{}");
  };
  const trials = ["trial-3", "trial-1", "trial-2"];
  for (const trial of trials) await outbox.putVote(trial, vote());
  await Promise.all([outbox.emptied(), outbox.emptied()]);
  assert.deepEqual(arrived, trials);
});

test("a vote that is put twice is kept once", async () => {
  serve(LOST);
  const given = vote();
  await outbox.putVote("trial-1", given);
  await outbox.putVote("trial-1", given);
  assert.deepEqual(await waiting(), ["trial-1"]);
});

test("an interruption is sent as one, with its reason", async () => {
  const requests = serve(200);
  const interruption = { reason: "hidden", viewing: { switches: [] } };
  await outbox.putInterruption("trial-1", interruption);
  await outbox.emptied();
  assert.equal(requests[0].url, "/api/v1/session/trials/trial-1/void");
  assert.deepEqual(requests[0].sent, interruption);
});

test("the votes of another participant at this browser are neither sent nor dropped", async () => {
  const requests = serve(LOST);
  await outbox.putVote("trial-1", vote());
  const next = new Outbox(shelf, "session-2");
  await next.emptied();
  await next.clear();
  assert.deepEqual(await waiting(), ["trial-1"]);
  assert.equal(requests.length, 1);
});

test("whoever withdraws leaves nothing behind", async () => {
  serve(LOST);
  await outbox.putVote("trial-1", vote());
  await outbox.clear();
  assert.deepEqual(await waiting(), []);
});

test("ids are UUIDs of version 7 that sort by when they were made", () => {
  const ids = Array.from({ length: 1000 }, (_, number) => {
    mock.timers.setTime(number * 997_000_000); // over 30 years
    return newId();
  });
  for (const id of ids) assert.match(id, /^[0-9a-f]{8}-[0-9a-f]{4}-7[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}$/);
  assert.deepEqual(ids.toSorted(), ids);
  mock.timers.setTime(0x0123456789ab);
  assert.equal(newId().slice(0, 13), "01234567-89ab");
});
