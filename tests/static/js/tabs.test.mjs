// One tab at a time has a session, also where the browser has no locks, as on a laboratory's plain http.

import assert from "node:assert/strict";
import { afterEach, test } from "node:test";

/** Channels of one browser: a message reaches every other open channel of the same name, a moment later. */
const open = new Set();
globalThis.BroadcastChannel = class {
  onmessage = (_event) => {};
  constructor(name) {
    this.name = name;
    open.add(this);
  }
  postMessage(data) {
    for (const other of [...open]) if (other !== this && other.name === this.name) queueMicrotask(() => open.has(other) && other.onmessage({ data }));
  }
  close() {
    open.delete(this);
  }
};
Object.defineProperty(globalThis, "navigator", { value: {} });
const { claim, takeOver } = await import("../../../static/js/tabs.js");
afterEach(() => open.clear());

const unexpected = () => assert.fail("nobody takes it over");

test("a second tab does not get a session that the first one has", async () => {
  assert.equal(await claim("one", unexpected), true);
  assert.equal(await claim("one", unexpected), false);
  assert.equal(await claim("another", unexpected), true);
});

test("a tab that takes the session over ends the other, and then has it itself", async () => {
  let nLost = 0;
  await claim("one", () => (nLost += 1));
  assert.equal(await takeOver("one", unexpected), true);
  await new Promise(setImmediate);
  assert.equal(nLost, 1);
  assert.equal(await claim("one", unexpected), false);
});
