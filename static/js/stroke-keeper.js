// Sends what is drawn to the server soon after each change: one request after the other, so that an older drawing never
// arrives after a newer one, and again where the server could not be reached.

const AFTER_MS = 500;
const AGAIN_AFTER_MS = 5000;

export class Keeper {
  /** @type {Map<string, number>} number of changes that the server may lack, by place */
  #changes = new Map();
  /** @type {Map<string, number>} */
  #timers = new Map();
  /** @type {Promise<unknown>} */
  #turn = Promise.resolve();

  /** @param {(place: string) => Promise<boolean>} send whether the server took it; rejects when it could not be reached */
  constructor(send) {
    this.send = send;
  }

  /** Has the server everything? */
  get isDone() {
    return this.#changes.size === 0;
  }

  /** Does the server lack a change? @param {string} place */
  lacks(place) {
    return this.#changes.has(place);
  }

  /** @param {string} place that has changed */
  soon(place) {
    this.#changes.set(place, (this.#changes.get(place) ?? 0) + 1);
    this.#sendIn(AFTER_MS, place);
  }

  /** @param {string} place @returns {Promise<boolean>} whether it is kept */
  now(place) {
    window.clearTimeout(this.#timers.get(place));
    const turn = this.#turn.then(() => this.#deliver(place));
    this.#turn = turn;
    return turn;
  }

  /** @param {number} milliseconds @param {string} place */
  #sendIn(milliseconds, place) {
    window.clearTimeout(this.#timers.get(place));
    this.#timers.set(place, window.setTimeout(() => this.now(place), milliseconds));
  }

  /** @param {string} place */
  async #deliver(place) {
    const n_changes = this.#changes.get(place);
    try {
      const isKept = await this.send(place);
      if (this.#changes.get(place) === n_changes) this.#changes.delete(place); // what is refused would be refused again
      return isKept;
    } catch {
      this.#sendIn(AGAIN_AFTER_MS, place);
      return false;
    }
  }
}
