/** Requests to the server, what can go wrong with them, and retries with growing pauses. */

export const LARGEST_KEPT_ALIVE = 32_768; // bytes; browsers refuse more than 64 KiB under way at once
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 30_000;
const TRY_AGAIN_STATUSES = new Set([408, 425, 429]);

/** The server could not be reached or could not answer now: the same call may succeed later. */
export class Unreachable extends Error {}

/** The server understood and said no; asking again would not help. */
export class Refusal extends Error {
  /** @param {number} status @param {string} detail */
  constructor(status, detail) {
    super(`${status} ${detail}`);
    this.status = status;
    this.detail = detail;
  }

  /** The problem that the server describes (RFC 9457). @returns {{standing?: "paused" | "closed", detail?: string}} why a study admits nobody; what it says */
  get problem() {
    try {
      return Object(JSON.parse(this.detail));
    } catch {
      return {};
    }
  }
}

/** A film could not be shown in this browser; the server has been told. */
export class FilmTrouble extends Error {}

/**
 * @param {string} url
 * @param {RequestInit} [options]
 * @returns {Promise<Response>} an answer with a good status
 */
export async function request(url, options) {
  const response = await fetch(url, options).catch((cause) => {
    const stopped = options?.signal?.reason;
    if (stopped && stopped.name !== "TimeoutError") throw stopped;
    throw new Unreachable(`no answer from ${url}`, { cause });
  });
  if (response.ok) return response;
  const detail = await response.text().catch(() => "");
  if (response.status >= 500 || TRY_AGAIN_STATUSES.has(response.status)) {
    throw new Unreachable(`${response.status} from ${url}: ${detail}`);
  }
  throw new Refusal(response.status, detail);
}

/**
 * @template T
 * @param {() => Promise<T>} action repeated, with growing pauses, until the server can be reached
 * @returns {Promise<T>}
 */
export async function patiently(action) {
  for (let failures = 0; ; failures += 1) {
    try {
      const result = await action();
      if (failures > 0) tellTrouble(-1);
      return result;
    } catch (error) {
      if (!(error instanceof Unreachable)) {
        if (failures > 0) tellTrouble(-1);
        throw error;
      }
      if (failures === 0) tellTrouble(+1);
      await untilNextTry(waitBeforeTry(failures));
    }
  }
}

/**
 * @param {number} failures so far, from 0
 * @returns {number} milliseconds, doubling up to half a minute; the random half keeps many clients from coming back at once
 */
export function waitBeforeTry(failures) {
  const longest = Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** failures);
  return Math.max(FIRST_WAIT_MS, longest * (0.5 + 0.5 * Math.random()));
}

/** @param {number} milliseconds at most: less if the browser says that it is online again */
function untilNextTry(milliseconds) {
  return new Promise((resolve) => {
    const done = () => {
      clearTimeout(timer);
      window.removeEventListener("online", done);
      resolve(undefined);
    };
    const timer = setTimeout(done, milliseconds);
    window.addEventListener("online", done);
  });
}

let troubles = 0;
/** @type {(isInTrouble: boolean) => void} */
let listener = () => {};

/** @param {(isInTrouble: boolean) => void} callback told when the first call gets into trouble and when the last is out of it */
export function onTrouble(callback) {
  listener = callback;
}

/** @param {number} change */
function tellTrouble(change) {
  troubles += change;
  listener(troubles > 0);
}
