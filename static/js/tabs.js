/** Lets one tab at a time have a session: two would send two votes for a trial. */

const PATIENCE_MS = 800; // a page that is being reloaded still holds the session for a moment

/**
 * Takes the session unless another tab has it. Where the browser has no locks (a laboratory's plain http), every tab takes
 * it; the server keeps a trial's first vote.
 * @param {string} session its id
 * @param {() => void} onLost another tab has taken the session over
 * @returns {Promise<boolean>} whether this tab has the session now
 */
export function claim(session, onLost) {
  return hold(session, { signal: AbortSignal.timeout(PATIENCE_MS) }, onLost);
}

/** Takes the session away from the tab that has it. @param {string} session @param {() => void} onLost */
export function takeOver(session, onLost) {
  return hold(session, { steal: true }, onLost);
}

/** @param {string} session @param {LockOptions} options @param {() => void} onLost @returns {Promise<boolean>} */
function hold(session, options, onLost) {
  if (!navigator.locks) return Promise.resolve(true);
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
