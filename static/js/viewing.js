/** The record of how a pair was looked at. Times are milliseconds of performance.now(), to a tenth. */

/** @typedef {import("./session.js").Viewing} Viewing */

const LONGEST_MS = 24 * 3600 * 1000; // the server's limit: a vote from a tab left open over a weekend still counts

/** @returns {NonNullable<Viewing["display"]>} */
export function display() {
  return {
    window_width: window.innerWidth,
    window_height: window.innerHeight,
    device_pixel_ratio: window.devicePixelRatio,
    full_screen: document.fullscreenElement !== null,
  };
}

/** @param {Viewing} viewing @param {boolean} hasReference @returns {NonNullable<Viewing["dwell_ms"]>} how long each was on screen */
export function dwell({ first_shown, shown_ms, switches }, hasReference) {
  const looks = { a: 0, b: 0, reference: 0 };
  /** @type {import("./session.js").Shown} */
  let shown = first_shown;
  let since = 0;
  for (const { to, at_ms } of [...switches, { to: shown, at_ms: shown_ms }]) {
    looks[shown] += Math.max(0, at_ms - since);
    [shown, since] = [to, at_ms];
  }
  return { a: tenths(looks.a), b: tenths(looks.b), ...(hasReference && { reference: tenths(looks.reference) }) };
}

/** @param {Viewing} viewing @returns {boolean} whether A and B were both on screen */
export function hasSeenBoth({ first_shown, switches }) {
  const seen = new Set([first_shown, ...switches.map(({ to }) => to)]);
  return seen.has("a") && seen.has("b");
}

/** @param {number} least_ms @param {Viewing} viewing whose exposure has ended @returns {boolean} whether A and B were each on screen as long */
export function hasSeenEachFor(least_ms, { dwell_ms }) {
  return Math.min(dwell_ms?.a ?? 0, dwell_ms?.b ?? 0) >= least_ms;
}

/** @param {number} milliseconds @returns {number} to a tenth, at most the server's limit */
export function tenths(milliseconds) {
  return Math.round(10 * Math.min(milliseconds, LONGEST_MS)) / 10;
}
