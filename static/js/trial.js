/**
 * One trial: loading -> fixation -> exposure -> voting -> done; interrupted when the participant looks away; or failed.
 * Before the fixation it is `unready` while the window is too small or the full screen is missing. Where the two were not
 * seen for long enough, the exposure is followed by `unseen`, which leads back to loading.
 * A state lives as long as its AbortSignal: leaving it ends its timers and listeners.
 */

import { required } from "./elements.js";
import { isTooSmallFor } from "./film-window.js";
import { watchPage } from "./happenings.js";
import { newId } from "./outbox.js";
import { SWITCH_KEYS, after, enterFullScreen, fill, isPlain } from "./page.js";
import { newPlayer } from "./technique.js";
import { settle } from "./settling.js";
import { areSingleKeysOn } from "./single-keys.js";
import { labelTrial, pressedByEnter, showProgress } from "./trial-screen.js";
import { ViewingRecord, tenths } from "./viewing.js";
import { askForAnswer } from "./vote-form.js";

/**
 * @typedef {import("./session.js").TrialDescription} TrialDescription
 * @typedef {import("./session.js").Vote} Vote
 * @typedef {import("./session.js").Letter} Letter
 * @typedef {import("./session.js").Shown} Shown
 * @typedef {import("./session.js").Reason} Reason
 * @typedef {import("./session.js").Happening} Happening
 * @typedef {import("./outbox.js").Interruption} Interruption
 * @typedef {"loading" | "unready" | "fixation" | "exposure" | "unseen" | "voting" | "done" | "interrupted" | "failed"} State
 * @typedef {{vote?: Vote, interruption?: Interruption, isRough?: boolean}} Outcome a vote or an interruption; isRough: the film did not run as it should
 */

const FIXATION_MS = 500;
const REFERENCE_KEY = "r"; // or what lies in its place on keyboards of other alphabets
const RIGHT_BUTTON = 2;
const MAY_COME_AGAIN = 1; // attempts; an interrupted repetition goes on, and its record says so

/** What happens to the page -> the reason that it is to interrupt a look, if the study's `void_on` has it. @type {Partial<Record<Happening, TrialDescription["void_on"][number]>>} */
const REASONS = { hidden: "hidden", "full screen left": "full screen", blur: "blur", resize: "resize" };

let pageIsLeft = false; // leaving the page hides it, too, and is a reason of its own
window.addEventListener("pagehide", () => (pageIsLeft = true));

/** @type {Record<State, State[]>} */
const FOLLOWERS = {
  loading: ["unready", "fixation", "failed"],
  unready: ["fixation"],
  fixation: ["exposure", "failed"],
  exposure: ["voting", "unseen", "interrupted", "failed"],
  unseen: ["loading"],
  voting: ["done"],
  done: [],
  interrupted: [],
  failed: [],
};

export class Trial {
  /**
   * @param {HTMLElement} screen
   * @param {TrialDescription} description
   * @param {import("./films.js").Film} film
   * @param {import("./session.js").Technique} technique
   * @param {import("./session.js").Viewing["happened"]} happened since the trial before it, at times of performance.now()
   */
  constructor(screen, description, film, technique, happened) {
    this.screen = screen;
    this.description = description;
    this.film = film;
    this.player = newPlayer(technique, required(HTMLElement, ".film", screen));
    this.record = new ViewingRecord(description, { technique, lighter_film: film.holds(description.media.lighter), happened });
    this.askedAt = NaN; // performance.now() when the participant was ready for it
    this.letter = description.first_shown; // the last of A and B that was shown
    /** @type {State} */
    this.state = "loading";
    this.leaving = new AbortController();
    this.lasting = new AbortController(); // the trial as a whole
    this.resolve = (/** @type {Outcome} */ _outcome) => {};
    this.reject = (/** @type {unknown} */ _reason) => {};
  }

  /** @param {number} askedAt performance.now() when the participant was ready for it @returns {Promise<Outcome>} rejects when the film cannot be shown */
  run(askedAt) {
    this.askedAt = askedAt;
    labelTrial(this.screen, this.description);
    watchPage(this.lasting.signal, (what) => this.#note(what));
    const outcome = new Promise((resolve, reject) => {
      this.resolve = resolve;
      this.reject = reject;
    });
    this.#enter("loading");
    return outcome;
  }

  /** Stops for good without an outcome: the study goes on in another tab, or its participant has withdrawn. */
  abandon() {
    this.leaving.abort();
    this.lasting.abort();
    this.player.unload();
  }

  /** The record of the look that is under way, should it end now because the page is left; null while there is none. @returns {Interruption | null} */
  get look() {
    const { hasBegun, viewing } = this.record;
    if (!hasBegun || this.state === "done") return null;
    const seen = this.state === "exposure" ? this.record.seen(this.player) : {};
    return { reason: "left the page", viewing: { ...viewing, ...seen } };
  }

  /** @param {State} state @param {unknown} [result] the outcome, or why it failed */
  #go(state, result) {
    if (!FOLLOWERS[this.state].includes(state)) throw new Error(`no way from ${this.state} to ${state}`);
    this.leaving.abort();
    this.leaving = new AbortController();
    this.state = state;
    this.#enter(state, result);
  }

  /** @param {State} state @param {unknown} [result] */
  #enter(state, result) {
    const { signal } = this.leaving;
    this.screen.dataset.state = state;
    if (state === "loading") this.#load(signal);
    else if (state === "unready") this.#awaitRoom(signal);
    else if (state === "fixation") this.#fixate(signal);
    else if (state === "exposure") this.#expose(signal);
    else if (state === "unseen") this.#offerAgain(signal);
    else if (state === "voting") this.#ask(signal);
    else this.#end(state, result);
  }

  /** @param {State} state @param {unknown} result */
  #end(state, result) {
    this.lasting.abort();
    this.player.unload();
    if (state === "failed") this.reject(result);
    else this.resolve(/** @type {Outcome} */ (result));
  }

  /** @param {AbortSignal} signal */
  #load(signal) {
    const { media } = this.description;
    showProgress(this.screen, this.film, signal);
    this.film.whole
      .then((blobs) => (signal.aborted ? undefined : this.player.load(blobs, media, this.record.shown, signal)))
      .then(() => signal.aborted || this.#go(this.#missing ? "unready" : "fixation"), (error) => signal.aborted || this.#go("failed", error));
  }

  /** What the film cannot be shown without; empty when it can. @returns {"" | "fullScreen" | "room"} */
  get #missing() {
    const { full_screen, minimum_window, media } = this.description;
    if (full_screen === "required" && !document.fullscreenElement) return "fullScreen";
    return isTooSmallFor(this.screen, media, minimum_window) ? "room" : "";
  }

  /** Asks for the full screen or a larger window, and goes on by itself once the film can be shown. @param {AbortSignal} signal */
  #awaitRoom(signal) {
    const text = required(HTMLElement, "#unready", this.screen);
    const button = required(HTMLButtonElement, ".enlarge", this.screen);
    const look = () => {
      const missing = this.#missing;
      if (!missing) this.#go("fixation");
      else text.textContent = text.dataset[missing] ?? "";
      button.hidden = document.fullscreenElement !== null || !document.fullscreenEnabled;
    };
    settle();
    look();
    window.addEventListener("resize", look, { signal });
    document.addEventListener("fullscreenchange", look, { signal });
    pressedByEnter(button, signal, enterFullScreen);
  }

  /** @param {AbortSignal} signal */
  #fixate(signal) {
    this.record.viewing.wait_ms ??= tenths(performance.now() - this.askedAt);
    this.screen.focus({ preventScroll: true });
    this.#show(this.record.shown);
    after(FIXATION_MS, signal, () => requestAnimationFrame((now) => signal.aborted || this.#begin(now)));
  }

  /** @param {number} now the animation frame that shows the film first */
  #begin(now) {
    this.record.begin(now);
    this.#go("exposure");
  }

  /** @param {AbortSignal} signal */
  #expose(signal) {
    const { free_exposure, exposure_s } = this.description;
    this.#listen(signal);
    if (document.visibilityState === "hidden") this.#note("hidden");
    if (!document.hasFocus()) this.#note("blur");
    if (signal.aborted) return;
    this.#watchFrames(signal);
    this.player.play(free_exposure ? Infinity : exposure_s, signal).then(
      () => this.#endExposure(),
      (error) => signal.aborted || this.#go("failed", error),
    );
  }

  /** Looks at every refresh whether the film runs; where one comes after long, as when the computer slept, the look ends. Where none comes any more the player fails. @param {AbortSignal} signal */
  #watchFrames(signal) {
    const look = (/** @type {number} */ now) => {
      if (signal.aborted) return;
      if (this.record.refresh(now, this.player.n_presented)) this.#interrupt("suspended");
      requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
  }

  /** Mouse and keys, as long as the film is shown. @param {AbortSignal} signal */
  #listen(signal) {
    const { free_exposure, media } = this.description;
    const onPress = (/** @type {PointerEvent} */ event) => {
      if (event.target instanceof Element && event.target.closest("button")) return;
      event.preventDefault();
      this.#switch(event.timeStamp, media.reference && (event.button === RIGHT_BUTTON || !event.isPrimary));
    };
    const onKey = (/** @type {KeyboardEvent} */ event) => {
      if (!isPlain(event)) return;
      const isForReference = media.reference && areSingleKeysOn() && (event.key.toLowerCase() === REFERENCE_KEY || event.code === "KeyR");
      if (isForReference || SWITCH_KEYS.has(event.key)) {
        event.preventDefault();
        if (!event.repeat) this.#switch(event.timeStamp, isForReference);
      } else if (free_exposure && event.key === "Enter" && !event.repeat) {
        event.preventDefault();
        this.#endExposure();
      }
    };
    this.screen.addEventListener("pointerdown", onPress, { signal });
    this.screen.addEventListener("mousedown", preventDefault, { signal }); // no scrolling by the middle button
    this.screen.addEventListener("contextmenu", preventDefault, { signal });
    document.addEventListener("keydown", onKey, { signal });
    required(HTMLElement, ".end-exposure", this.screen).addEventListener("click", () => this.#endExposure(), { signal });
  }

  /** Notes what happened to the page; it interrupts what is seen where the study says so. @param {Happening} what */
  #note(what) {
    if (pageIsLeft) return;
    this.record.note(what, this.#isBetweenExposures);
    const reason = REASONS[what];
    if (this.state === "exposure" && reason && this.description.void_on.includes(reason)) this.#interrupt(reason);
  }

  /** @param {Reason} reason */
  #interrupt(reason) {
    if (this.description.attempt > MAY_COME_AGAIN) {
      this.record.viewing.interruption = reason;
      return;
    }
    this.record.close(this.player);
    this.#go("interrupted", { interruption: { reason, viewing: this.record.viewing }, isRough: this.record.isRough });
  }

  /** Whether the pair is about to be shown again: meanwhile the clock of the record stands. */
  get #isBetweenExposures() {
    return this.record.hasBegun && ["unseen", "loading", "unready", "fixation"].includes(this.state);
  }

  #endExposure() {
    if (this.record.close(this.player)) this.#interrupt("suspended");
    if (this.state !== "exposure") return;
    this.#go(this.record.lack ? "unseen" : "voting");
    this.player.pause();
  }

  /** Shows the pair again once the participant is ready. @param {AbortSignal} signal */
  #offerAgain(signal) {
    this.record.keepCounts(this.player);
    const text = required(HTMLElement, "#unseen", this.screen);
    text.textContent = fill(text.dataset[this.record.lack || "unseen"], { seconds: this.description.minimum_viewing_s });
    settle(); // a press meant to switch comes too late
    pressedByEnter(required(HTMLButtonElement, ".show-again", this.screen), signal, () => {
      enterFullScreen();
      this.#go("loading");
    });
  }

  /**
   * From A to B or back; the reference lasts until the next press, which leads back to what was shown before it.
   * @param {number} at performance.now() of the press @param {boolean} isForReference
   */
  #switch(at, isForReference) {
    if (this.description.media.layout === "single") return;
    const isAtReference = this.player.shown === "reference";
    /** @type {Letter} */
    const letter = isAtReference ? this.letter : this.letter === "a" ? "b" : "a";
    const to = isForReference && !isAtReference ? "reference" : letter;
    this.#show(to);
    this.record.addSwitch(to, at, this.player.mediaTime);
  }

  /** @param {Shown} which */
  #show(which) {
    this.player.show(which);
    if (which !== "reference") this.letter = which;
    this.screen.dataset.letter = which;
    const status = required(HTMLElement, "[data-showing]", this.screen);
    const { showing, showingReference, a, b } = status.dataset;
    const isAlone = this.description.media.layout === "single";
    const told = which === "reference" ? showingReference : fill(showing, { letter: which === "a" ? a : b });
    status.textContent = isAlone ? "" : told ?? "";
  }

  /** @param {AbortSignal} signal */
  #ask(signal) {
    const openedAt = performance.now();
    const form = required(HTMLFormElement, "form", this.screen);
    askForAnswer(form, signal, (answer, n_changes) => this.#vote(answer, performance.now() - openedAt, n_changes));
  }

  /** @param {import("./vote-form.js").Answer} answer @param {number} response_ms @param {number} n_changes */
  #vote(answer, response_ms, n_changes) {
    const { viewing } = this.record;
    viewing.response_ms = tenths(response_ms);
    viewing.n_changes = n_changes;
    if (this.description.following) enterFullScreen(); // Esc may have ended it, and this is a press
    this.#go("done", { vote: { id: newId(), ...answer, viewing }, isRough: this.record.isRough });
  }
}

/** @param {Event} event */
function preventDefault(event) {
  event.preventDefault();
}
