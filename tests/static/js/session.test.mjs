import assert from "node:assert/strict";
import { afterEach, test } from "node:test";

import { serve } from "./server.mjs";
import { Refusal, Unreachable, waitBeforeTry } from "../../../static/js/connection.js";
import * as session from "../../../static/js/session.js";

afterEach(() => session.stayWith(""));

const VOTE = { id: "0", choice: "a", viewing: {} };
const CALLS = [
  [() => session.beginSession("my study", "invite", "key"), "POST /studies/my%20study/sessions", { invitation: "invite", key: "key" }],
  [() => session.tellTurnedAway("s/1", "invite"), "POST /studies/s%2F1/turned-away", { invitation: "invite" }],
  [() => session.withdraw(), "PUT /session/withdrawal", {}],
  [() => session.resumeSession("k7m2", "key"), "POST /session/resume", { resume_code: "k7m2", key: "key" }],
  [() => session.readSession(), "GET /session"],
  [() => session.completeStage("practice", { rounds: [] }), "PUT /session/stages/practice", { data: { rounds: [] } }],
  [() => session.markComprehension("wait"), "PUT /session/comprehension", { answer: "wait" }],
  [() => session.readScreening(), "GET /session/screening"],
  [() => session.sendCard({ n: 1 }), "PUT /session/screening/display", { n: 1 }],
  [() => session.sendDistance({ typed_cm: 60 }), "PUT /session/screening/distance", { typed_cm: 60 }],
  [() => session.readItem("acuity"), "GET /session/screening/acuity"],
  [() => session.answerItem("acuity", 3, { answer: null }), "PUT /session/screening/acuity/3", { answer: null }],
  [() => session.skipTest("acuity", "no card"), "PUT /session/screening/acuity/skip", { reason: "no card" }],
  [() => session.readPractice(), "GET /session/practice"],
  [() => session.readNextTrial(), "GET /session/trials/next"],
  [() => session.sendVote("a/b", VOTE), "PUT /session/trials/a%2Fb/vote", VOTE],
  [() => session.sendVoid("t", { reason: "hidden" }), "PUT /session/trials/t/void", { reason: "hidden" }],
  [() => session.tellTrouble("t", "x".repeat(1000)), "PUT /session/trials/t/trouble", { why: "x".repeat(300) }],
];

for (const [call, route, body] of CALLS) {
  test(`asks ${route}`, async () => {
    const requests = serve([200, '{"answer":1}']);
    assert.deepEqual(await call(), { answer: 1 });
    assert.deepEqual(requests.map(({ method, url }) => `${method} ${url}`), [route.replace(" ", " /api/v1")]);
    assert.deepEqual(requests[0].sent, body);
    assert.equal(requests[0].headers["Content-Type"], body && "application/json");
  });
}

test("an empty answer is null", async () => {
  serve(204);
  assert.equal(await session.readNextTrial(), null);
});

test("every request names the page's session once there is one", async () => {
  const requests = serve(200);
  await session.readSession();
  session.stayWith("session-1");
  await session.readSession();
  await session.sendVote("t", VOTE);
  await session.readPicture("/picture.png");
  assert.deepEqual(requests.map(({ headers }) => headers["Session-Id"]), [undefined, "session-1", "session-1", "session-1"]);
});

test("a vote on its way survives the page unless it is too large for browsers", async () => {
  const requests = serve(200);
  const padding = 32_768 - JSON.stringify({ ...VOTE, id: "" }).length;
  await session.sendVote("t", { ...VOTE, id: "i".repeat(padding - 1) });
  await session.sendVote("t", { ...VOTE, id: "i".repeat(padding) });
  assert.deepEqual(requests.map(({ keepalive }) => keepalive), [true, false]);
});

test("no answer, half an answer and a server that cannot answer now are worth another try", async () => {
  for (const answer of [new TypeError("Failed to fetch"), [200, '{"half'], 408, 425, 429, 500, 502, 503, 504]) {
    serve(answer);
    await assert.rejects(session.readSession(), Unreachable, String(answer));
  }
});

test("any other status is a refusal that tells what the server said", async () => {
  for (const status of [400, 401, 403, 404, 409, 410, 413, 422]) {
    serve([status, '{"standing":"paused"}']);
    const refusal = await session.readSession().catch((error) => error);
    assert.ok(refusal instanceof Refusal);
    assert.equal(refusal.status, status);
    assert.equal(refusal.problem.standing, "paused");
  }
});

test("a refusal without a problem document has an empty problem", () => {
  for (const detail of ["", "<html>", "null", "3"]) assert.equal(new Refusal(404, detail).problem.standing, undefined);
});

test("a picture that breaks off is worth another try", async () => {
  globalThis.fetch = async () => new Response(new ReadableStream({ start: (stream) => stream.error(new Error("reset")) }));
  await assert.rejects(session.readPicture("/picture.png"), Unreachable);
});

test("a wait is between half of and the whole doubled wait, and within a quarter of a second and half a minute", () => {
  for (let failures = 0; failures < 2000; failures += 1) {
    const longest = Math.min(30_000, 250 * 2 ** failures);
    const wait = waitBeforeTry(failures);
    assert.ok(wait >= Math.max(250, longest / 2) && wait <= longest, `${wait} after ${failures} failures`);
  }
});
