/**
 * Lets one tab at a time have a session: two would send two votes for a trial. A browser that does not answer lets any.
 */

import { within } from "./patience.js";

const PATIENCE_MS = 800; // a page that is being reloaded still holds the session for a moment
const ANSWER_MS = 300; // for other tabs to say that they have it

/**
 * Takes the session unless another tab has it. Where the browser has no locks (a laboratory's plain http), the tabs ask each
 * other; two that are opened at the same moment both take it, and the server keeps a trial's first vote.
 * @param {string} session its id
 * @param {() => void} onLost another tab has taken the session over
 * @returns {Promise<boolean>} whether this tab has the session now
 */
export function claim(session, onLost) {
  return within(hold(session, { signal: AbortSignal.timeout(PATIENCE_MS) }, onLost)).catch(() => true);
}

/** Takes the session away from the tab that has it. @param {string} session @param {() => void} onLost */
export function takeOver(session, onLost) {
  return within(hold(session, { steal: true }, onLost)).catch(() => true);
}

/** @param {string} session @param {LockOptions} options @param {() => void} onLost @returns {Promise<boolean>} */
function hold(session, options, onLost) {
  if (!navigator.locks) return "steal" in options ? takeByWord(session, onLost) : askByWord(session, onLost);
  return new Promise((resolve) => {
    let isHeld = false;
    navigator.locks
      .request(`reconstudy ${session}`, options, () => {
        isHeld = true;
        resolve(true);
        return new Promise(() => {}); // until the page is left
      })
      .catch(() => (isHeld ? onLost() : resolve(false)));
  });
}

/** @param {string} session @param {() => void} onLost @returns {Promise<boolean>} false when another tab answers that it has the session */
function askByWord(session, onLost) {
  const channel = new BroadcastChannel(`reconstudy ${session}`);
  return new Promise((resolve) => {
    const timer = setTimeout(() => {
      holdByWord(channel, onLost);
      resolve(true);
    }, ANSWER_MS);
    channel.onmessage = ({ data }) => {
      if (data !== "mine") return;
      clearTimeout(timer);
      channel.close();
      resolve(false);
    };
    channel.postMessage("whose?");
  });
}

/** @param {string} session @param {() => void} onLost @returns {Promise<boolean>} */
function takeByWord(session, onLost) {
  const channel = new BroadcastChannel(`reconstudy ${session}`);
  channel.postMessage("now mine");
  holdByWord(channel, onLost);
  return Promise.resolve(true);
}

/** Answers other tabs until one of them takes the session over. @param {BroadcastChannel} channel @param {() => void} onLost */
function holdByWord(channel, onLost) {
  channel.onmessage = ({ data }) => {
    if (data === "whose?") channel.postMessage("mine");
    if (data !== "now mine") return;
    channel.close();
    onLost();
  };
}
