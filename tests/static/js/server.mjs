// A server, a clock and the few parts of a browser that the session's code needs, for tests in node.

import { mock } from "node:test";

globalThis.window = new EventTarget();

/**
 * Puts a server in place of `fetch`: it gives out the answers in turn, the last one again and again.
 * An answer is a status, `[status, body]`, or an Error: no connection.
 */
export function serve(...answers) {
  const requests = [];
  globalThis.fetch = async (url, { method = "GET", headers = {}, body, keepalive } = {}) => {
    const answer = answers[Math.min(requests.length, answers.length - 1)];
    const sent = body && JSON.parse(new TextDecoder().decode(body));
    requests.push({ method, url, headers, sent, keepalive, at: Date.now() });
    if (answer instanceof Error) throw answer;
    const [status, text] = [answer, '{"ok":true}'].flat();
    return new Response(status === 204 ? null : text, { status });
  };
  return requests;
}

/** Stops the clock at 0, and takes the randomness out of waits: each is as long as it may be. */
export function stopClock() {
  mock.timers.enable({ apis: ["setTimeout", "Date"], now: 0 });
  mock.method(Math, "random", () => 1 - Number.EPSILON);
}

/** Lets time pass, and all that follows from it happen, in steps as short as the shortest wait. */
export async function pass(milliseconds) {
  await settle();
  for (let left = milliseconds; left > 0; left -= 250) {
    mock.timers.tick(Math.min(left, 250));
    await settle();
  }
}

/** Lets everything happen that waits for no timer. */
export async function settle() {
  for (let turn = 0; turn < 5; turn += 1) await new Promise((resolve) => setImmediate(resolve));
}
