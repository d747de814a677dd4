/** The record of how a pair was looked at. Times are milliseconds of performance.now(), to a tenth. */

import { Smoothness } from "./smoothness.js";

/**
 * @typedef {import("./session.js").Viewing} Viewing
 * @typedef {import("./session.js").Happening} Happening
 * @typedef {import("./session.js").Shown} Shown
 */

/** @typedef {Pick<import("./technique.js").Player, "n_presented" | "quality">} Played what a player has shown */

const FEWEST_FRAMES = 0.5; // of a film's, as the server judges a look
const LATEST_PICTURE_MS = 250; // after a press
const MOST_HAPPENINGS = 500; // in a record
const RESIZING_MS = 500; // the same resizing, if its events are not farther apart
const LONGEST_MS = 24 * 3600 * 1000; // the server's limit: a vote from a tab left open over a weekend still counts

/** The record of one attempt at a trial, over all its exposures. */
export class ViewingRecord {
  /**
   * @param {import("./session.js").TrialDescription} description
   * @param {Pick<Viewing, "technique" | "lighter_film" | "happened">} facts what happened: since the trial before it, at times of performance.now()
   */
  constructor(description, facts) {
    this.description = description;
    /** @type {Viewing} */
    this.viewing = { first_shown: description.first_shown, shown_ms: 0, response_ms: 0, switches: [], ...facts };
    this.firstShownAt = NaN; // performance.now() of the first frame on screen; moved on by pauses in which no film was shown
    this.smoothness = new Smoothness(description.media.fps);
    /** @type {Record<string, number>} of frames and stalls in earlier exposures */
    this.counts = {};
  }

  /** Has the film been on screen? */
  get hasBegun() {
    return !Number.isNaN(this.firstShownAt);
  }

  /** What is on screen. @returns {Shown} */
  get shown() {
    return this.viewing.switches.at(-1)?.to ?? this.viewing.first_shown;
  }

  /** Begins an exposure. @param {number} now the animation frame that shows the film first */
  begin(now) {
    const { happened, shown_ms } = this.viewing;
    if (this.hasBegun) happened.push({ what: "shown again", at_ms: shown_ms });
    else for (const event of happened) event.at_ms = tenths(event.at_ms - now);
    this.firstShownAt = now - shown_ms;
    this.smoothness.begin(shown_ms, Date.now());
    this.viewing.display = display();
  }

  /** Notes what happened to the page. @param {Happening} what @param {boolean} isPaused between two exposures the record's clock stands */
  note(what, isPaused) {
    const { happened, shown_ms } = this.viewing;
    const last = happened.at(-1);
    const at_ms = isPaused ? shown_ms : tenths(performance.now() - (this.firstShownAt || 0));
    if (what === "hidden") this.smoothness.isHidden = true;
    const isSameResizing = what === "resize" && last?.what === what && at_ms - last.at_ms < RESIZING_MS;
    if (!isSameResizing && happened.length < MOST_HAPPENINGS) happened.push({ what, at_ms });
  }

  /** Notes a switch, and at the next two refreshes of the display when its picture was there. @param {Shown} to @param {number} at performance.now() of the press @param {number} media_time_s */
  addSwitch(to, at, media_time_s) {
    const { switches } = this.viewing;
    // A mouse and a keyboard may each date their presses a little differently; the order is what happened.
    const at_ms = Math.max(this.#since(at), switches.at(-1)?.at_ms ?? 0);
    /** @type {Viewing["switches"][number]} */
    const record = { to, at_ms, media_time_s, frame: Math.round(media_time_s * this.description.media.fps) };
    switches.push(record);
    requestAnimationFrame((drawn) => {
      record.frame_ms = this.#since(drawn);
      requestAnimationFrame((presented) => (record.presented_ms = this.#since(presented))); // the display has it by now
    });
  }

  /** Notes a refresh of the display. @param {number} now @param {number} n_presented frames in the present exposure @returns {boolean} whether a frame has come, and none before it for so long that it was no viewing */
  refresh(now, n_presented) {
    const isSuspended = this.#isSuspended(now, n_presented);
    return this.smoothness.refresh(this.#since(now), n_presented, Date.now()) && isSuspended;
  }

  /** What was seen until now. @param {Played} played of the present exposure @returns {Partial<Viewing>} */
  seen(played) {
    const shown_ms = this.#since(performance.now());
    const dwell_ms = dwell({ ...this.viewing, shown_ms }, this.smoothness, this.description.media.reference);
    const gap_ms = this.smoothness.gap(shown_ms, played.n_presented, Date.now());
    const { longest_gap_ms, n_presented, n_refreshes } = this.smoothness;
    const smoothness = { longest_gap_ms: tenths(Math.max(longest_gap_ms, gap_ms)), n_presented, n_refreshes };
    return { shown_ms, dwell_ms, smoothness, ...this.#together(played.quality) };
  }

  /** Ends an exposure. @param {Played} played in it @returns {boolean} whether no frame had come for so long that it was no viewing */
  close(played) {
    const isSuspended = this.#isSuspended(performance.now(), played.n_presented);
    this.smoothness.end(this.#since(performance.now()), played.n_presented, Date.now());
    Object.assign(this.viewing, this.seen(played));
    return isSuspended;
  }

  /** Has there been no frame for longer than a look may have none? In a page that is hidden nothing is painted, which is a reason of its own. @param {number} now @param {number} n_presented */
  #isSuspended(now, n_presented) {
    const gap_ms = this.smoothness.gap(this.#since(now), n_presented, Date.now());
    return gap_ms > this.description.longest_gap_ms && !this.smoothness.isHidden;
  }

  /** Did half of the film's frames not come, the page not paint so often, most pictures come late, or none for long? */
  get isRough() {
    const { n_presented, n_refreshes, longest_gap_ms, step_ms } = this.smoothness;
    const isFewer = Math.min(n_presented, n_refreshes) < (FEWEST_FRAMES * this.viewing.shown_ms) / step_ms;
    const late = this.viewing.switches.filter(({ at_ms, presented_ms = 0 }) => presented_ms - at_ms > LATEST_PICTURE_MS);
    const isLate = late.length > this.viewing.switches.length / 2;
    return isFewer || isLate || longest_gap_ms > this.description.longest_gap_ms;
  }

  /** Keeps the counts of an exposure that another follows. @param {Played} played in it */
  keepCounts(played) {
    this.counts = this.#together(played.quality);
  }

  /** Why the pair is to be shown again before the vote; empty when it is not. @returns {"" | "unseen" | "brief"} */
  get lack() {
    const { see_both, minimum_viewing_s } = this.description;
    if (see_both && !hasSeenBoth(this.viewing)) return "unseen";
    return hasSeenEachFor(1000 * minimum_viewing_s, this.viewing) ? "" : "brief";
  }

  /** Counts of frames and stalls in all exposures. @param {Record<string, number>} counts of the present one */
  #together(counts) {
    const sums = { ...this.counts };
    for (const [name, count] of Object.entries(counts)) sums[name] = (sums[name] ?? 0) + count;
    return sums;
  }

  /** @param {number} at performance.now() @returns {number} ms, to a tenth, since the film appeared */
  #since(at) {
    return tenths(Math.max(0, at - this.firstShownAt));
  }
}

/** @returns {NonNullable<Viewing["display"]>} */
function display() {
  return {
    window_width: window.innerWidth,
    window_height: window.innerHeight,
    device_pixel_ratio: window.devicePixelRatio,
    full_screen: document.fullscreenElement !== null,
  };
}

/** @param {Viewing} viewing @param {Smoothness} smoothness @param {boolean} hasReference @returns {NonNullable<Viewing["dwell_ms"]>} how long each was on screen and ran: nobody looks at a film that stands still */
function dwell({ first_shown, shown_ms, switches }, smoothness, hasReference) {
  const looks = { a: 0, b: 0, reference: 0 };
  /** @type {Shown} */
  let shown = first_shown;
  let since = 0;
  for (const { to, at_ms } of [...switches, { to: shown, at_ms: shown_ms }]) {
    looks[shown] += Math.max(0, at_ms - since - smoothness.stillBetween(since, at_ms));
    [shown, since] = [to, at_ms];
  }
  return { a: tenths(looks.a), b: tenths(looks.b), ...(hasReference && { reference: tenths(looks.reference) }) };
}

/** @param {Viewing} viewing @returns {boolean} whether A and B were both on screen */
function hasSeenBoth({ first_shown, switches }) {
  const seen = new Set([first_shown, ...switches.map(({ to }) => to)]);
  return seen.has("a") && seen.has("b");
}

/** @param {number} least_ms @param {Viewing} viewing whose exposure has ended @returns {boolean} whether A and B were each on screen as long */
function hasSeenEachFor(least_ms, { dwell_ms }) {
  return Math.min(dwell_ms?.a ?? 0, dwell_ms?.b ?? 0) >= least_ms;
}

/** @param {number} milliseconds @returns {number} to a tenth, within the server's limits */
export function tenths(milliseconds) {
  return Math.round(10 * Math.max(-LONGEST_MS, Math.min(milliseconds, LONGEST_MS))) / 10;
}
