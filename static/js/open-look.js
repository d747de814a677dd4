/**
 * Keeps the look that is under way in this browser's storage, so that what was seen is recorded, and what was chosen is
 * sent, even if the page is left in the middle: the next page of the session, in any tab, puts it into the outbox.
 */

import { inBrowser } from "./remembered.js";

/**
 * @typedef {import("./outbox.js").Outbox} Outbox
 * @typedef {import("./trial.js").Outcome} Outcome
 */

export class OpenLook {
  /** @param {string} session its id */
  constructor(session) {
    this.name = `look of ${session}`;
  }

  /** Takes the place of what was noted before; the storage is written at once, unlike the outbox. @param {string} trial @param {Outcome} outcome if the page were left now */
  note(trial, outcome) {
    inBrowser.set(this.name, JSON.stringify({ trial, ...outcome }));
  }

  /** Resolves when the outbox has what a page before this one noted and could not finish. @param {Outbox} outbox */
  async settle(outbox) {
    const { trial, vote, interruption } = JSON.parse(inBrowser.get(this.name) ?? "{}");
    if (vote) await outbox.putVote(trial, vote);
    if (interruption) await outbox.putInterruption(trial, interruption);
    this.forget();
  }

  forget() {
    inBrowser.forget(this.name);
  }
}
