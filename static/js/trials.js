/** Runs a session's trials, fetches the next film meanwhile, and goes on for a trial while the server cannot be reached. */

import { FilmTrouble, Refusal, patiently } from "./connection.js";
import { Films } from "./films.js";
import { watchPage } from "./happenings.js";
import { readFilmsAhead, readNextTrial, sendVoid, tellTrouble } from "./session.js";
import { filmsOf } from "./technique.js";
import { minutesLeft, quarterDone } from "./time-left.js";
import { Trial } from "./trial.js";
import { tell } from "./views.js";

/**
 * @typedef {import("./session.js").TrialDescription} TrialDescription
 * @typedef {import("./session.js").Technique} Technique
 * @typedef {import("./outbox.js").Outbox} Outbox
 * @typedef {import("./open-look.js").OpenLook} OpenLook
 */

const SYNC_PATIENCE_MS = 1500; // before the study goes on without the server, with what is already here
const FEWEST_AFTER_BREAK = 5;
const NOT_FOUND = 404; // status of an answer: the film is missing
const ROUGH_LOOKS = 2; // after which a computer is taken for too slow
const MOST_BETWEEN = 100; // happenings between two trials; a record has room for 500
const NOTED_EVERY_MS = 500; // what a browser that crashes loses of a look
/** @type {Promise<never>} for what was under way when the study was abandoned */
const NEVER = new Promise(() => {});

export class Trials {
  /** @param {HTMLElement} screen @param {Technique | null} technique null: this browser can show none @param {number} breakEvery trials; 0: never */
  constructor(screen, technique, breakEvery) {
    this.screen = screen;
    this.technique = technique;
    this.breakEvery = breakEvery;
    this.lastBreak = 0; // answers before it
    /** About how long each stage takes. @type {Partial<Record<import("./session.js").Stage, number>>} */
    this.minutes = {};
    this.films = new Films();
    this.isLighter = false; // whether films with fewer bytes are shown, because the line is slow
    this.hasLighter = false; // whether there are such films, as far as is known
    /** The trial after the present one, in case the server cannot be reached. @type {TrialDescription | null} */
    this.ahead = null;
    /** @type {Trial | null} */
    this.current = null;
    this.isAbandoned = false;
    this.n_rough = 0; // looks at films that did not run as they should
    this.n_fetches = 0; // calls of `fetchAhead`, of which the last goes on
    this.between = new AbortController(); // ends when the next trial begins
    /** What happened to the page since the last trial. @type {import("./session.js").Viewing["happened"]} */
    this.happened = [];
  }

  #stopNoting = () => {};

  /**
   * Asks for a trial when the server has every vote before it; while the server cannot be reached, shows the one fetched ahead.
   * @param {Outbox} outbox @param {OpenLook} openLook @returns {Promise<"over" | "break" | "slow" | "interrupted" | "suspended">} why it stopped
   */
  async run(outbox, openLook) {
    for (;;) {
      const askedAt = performance.now();
      const description = await this.#next(outbox);
      if (this.isAbandoned) return NEVER;
      if (!description) return "over";
      const quarter = JSON.parse(this.screen.dataset.quarters ?? "[]")[quarterDone(description) - 1] ?? "";
      tell({ left: minutesLeft(this.minutes, description), quarter });
      if (this.#isTimeForBreak(description)) return "break";
      this.ahead = description.following ?? null;
      const { interruption, isRough } = await this.#take(description, askedAt, outbox, openLook);
      if (isRough) this.n_rough += 1;
      if (isRough && this.n_rough === ROUGH_LOOKS) return "slow"; // told once
      if (interruption) return interruption.reason === "suspended" ? "suspended" : "interrupted";
    }
  }

  /** Shows a trial, of the study or to practise. @param {TrialDescription} description @param {number} askedAt performance.now() when the participant was ready for it */
  async show(description, askedAt) {
    if (this.isAbandoned) return NEVER;
    this.between.abort();
    this.current = new Trial(this.screen, description, this.#film(description.media), this.#knownTechnique(), this.happened);
    try {
      return await this.current.run(askedAt);
    } catch (error) {
      if (error instanceof Refusal && error.status !== NOT_FOUND) throw error;
      const why = error instanceof Error && error.message ? error.message : String(error);
      const said = error instanceof Refusal && error.problem.detail ? `${error.status} ${error.problem.detail}` : why;
      await tellTrouble(description.trial, said).catch(() => {}); // the page says so in any case
      throw new FilmTrouble(said, { cause: error });
    } finally {
      this.current = null;
      this.#watchUntilNext();
    }
  }

  /** Keeps what happens between two trials for the record of the next. */
  #watchUntilNext() {
    this.between = new AbortController();
    this.happened = [];
    watchPage(this.between.signal, (what) => {
      if (this.happened.length < MOST_BETWEEN) this.happened.push({ what, at_ms: performance.now() });
    });
  }

  /**
   * Fetches films, one after the other: these first, then those of the next trials as long as there is time. Others are
   * forgotten.
   * @param {import("./session.js").Media[]} first
   */
  async fetchAhead(first) {
    this.n_fetches += 1;
    const number = this.n_fetches;
    const isOver = () => this.isAbandoned || number !== this.n_fetches;
    try {
      this.#lookForLighter(first);
      for (const media of first) if (!isOver()) await this.#film(media).whole;
      if (isOver()) return;
      const next = await readFilmsAhead();
      if (isOver()) return;
      this.#lookForLighter(next);
      this.films.keepOnly([...first, ...next].map((media) => this.#urlsOf(media)));
      for (const media of next) if (!isOver()) await this.#film(media).whole;
    } catch {
      // What could not be fetched ahead is fetched when it is shown.
    }
  }

  /** @param {import("./session.js").Media[]} medias */
  #lookForLighter(medias) {
    const technique = this.#knownTechnique();
    const isOther = (/** @type {import("./session.js").Media} */ media) => filmsOf(technique, media, true)[0] !== filmsOf(technique, media)[0];
    this.hasLighter ||= medias.some(isOther);
  }

  /** Shows films with fewer bytes from now on; what is on its way is not fetched any further. */
  lighten() {
    this.isLighter = true;
    this.n_fetches += 1; // ends a fetching ahead
    this.films.stop();
  }

  /** Seconds that the line needs for a film; NaN: not known yet. */
  get filmSeconds() {
    return this.films.latest?.seconds ?? NaN;
  }

  /** Should lighter films be shown, which the study has? @param {number} longest_s that a film may take to come */
  shouldLighten(longest_s) {
    const isTooSlow = this.films.latest?.isSpeedSure && this.filmSeconds >= longest_s;
    return Boolean(isTooSlow && this.hasLighter && !this.isLighter);
  }

  /** The line's speed, to a tenth; null: not known yet. */
  get line_mbit_s() {
    const speed = this.films.latest?.mbit_s ?? NaN;
    return Number.isNaN(speed) ? null : Math.round(10 * speed) / 10;
  }

  /** Stops the present trial for good, and any whose description or film is still on its way. */
  abandon() {
    this.isAbandoned = true;
    this.#stopNoting();
    this.current?.abandon();
  }

  /** @param {Outbox} outbox @returns {Promise<TrialDescription | null>} */
  #next(outbox) {
    const fresh = this.#upToDate(outbox);
    fresh.catch(() => {}); // it may fail after the study went on without it; then the next call tells
    return this.ahead ? Promise.race([fresh, this.#withoutServer(this.ahead)]) : fresh;
  }

  /** @param {Outbox} outbox @returns {Promise<TrialDescription | null>} */
  async #upToDate(outbox) {
    await outbox.emptied();
    return patiently(async () => (this.isAbandoned ? null : readNextTrial()));
  }

  /** @param {TrialDescription} following @returns {Promise<TrialDescription>} once its film is here and the server has had its time */
  async #withoutServer(following) {
    const film = this.#film(following.media).whole.catch(() => NEVER); // one that fails is told of when it is shown
    await Promise.all([film, new Promise((resolve) => setTimeout(resolve, SYNC_PATIENCE_MS))]);
    return following;
  }

  /** @param {TrialDescription} description @param {number} askedAt @param {Outbox} outbox @param {OpenLook} openLook @returns {Promise<import("./trial.js").Outcome>} */
  async #take(description, askedAt, outbox, openLook) {
    const { following } = description;
    this.fetchAhead([description, following].flatMap((trial) => (trial ? [trial.media] : [])));
    const outcome = await this.#showNoted(description, askedAt, openLook);
    const { vote, interruption } = outcome;
    openLook.note(description.trial, { vote, interruption }); // until the outbox has it
    if (vote) await outbox.putVote(description.trial, vote);
    if (interruption) await outbox.putInterruption(description.trial, interruption);
    openLook.forget();
    return outcome;
  }

  /** Shows a trial; the look is noted meanwhile, and reported when the page is left. @param {TrialDescription} description @param {number} askedAt @param {OpenLook} openLook */
  async #showNoted(description, askedAt, openLook) {
    const { trial } = description;
    const note = () => {
      const interruption = this.current?.look;
      if (interruption) openLook.note(trial, { interruption });
      return interruption;
    };
    const leave = () => {
      const interruption = note();
      if (interruption) sendVoid(trial, interruption).catch(() => {}); // the next page sends it again
    };
    const timer = setInterval(note, NOTED_EVERY_MS);
    window.addEventListener("pagehide", leave);
    this.#stopNoting = () => {
      clearInterval(timer);
      window.removeEventListener("pagehide", leave);
    };
    try {
      return await this.show(description, askedAt);
    } finally {
      this.#stopNoting();
    }
  }

  /** @param {TrialDescription} description of the trial that comes */
  #isTimeForBreak({ number, total }) {
    const answered = number - 1;
    if (!this.breakEvery || answered % this.breakEvery || answered === this.lastBreak) return false;
    if (total - answered < FEWEST_AFTER_BREAK) return false;
    this.lastBreak = answered;
    tell({ done: answered, total });
    return answered > 0;
  }

  /** @param {import("./session.js").Media} media @returns {import("./films.js").Film} perhaps still on its way */
  #film(media) {
    return this.films.get(this.#urlsOf(media));
  }

  /** @param {import("./session.js").Media} media */
  #urlsOf(media) {
    return filmsOf(this.#knownTechnique(), media, this.isLighter);
  }

  /** @returns {Technique} */
  #knownTechnique() {
    if (!this.technique) throw new Error("this browser cannot show the films");
    return this.technique;
  }
}
