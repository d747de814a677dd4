/**
 * Notes how a film runs on the display: how many of its frames were presented, and for how long none was. Times are
 * milliseconds of a look's own clock, which stands between two exposures.
 */

const STILL_MS = 250; // a frame that stays longer is a standstill, which is no viewing of the film
const LONGEST_STEPS = 1.5; // or as much longer than the film's own step, where that is long
const SLEEP_MS = 1000; // of the wall clock ahead of the page's: it is set by less

export class Smoothness {
  /** @param {number} fps frames a second of the film */
  constructor(fps) {
    this.step_ms = 1000 / fps;
    this.longest_gap_ms = 0;
    this.n_presented = 0;
    this.n_refreshes = 0;
    /** Times in which the film stood still. @type {{from_ms: number, to_ms: number}[]} */
    this.stills = [];
    this.before = { at_ms: 0, n_presented: 0, wall_ms: 0 }; // the last frame
    this.isHidden = false; // since that frame the page was hidden, where nothing is painted
  }

  /** Begins an exposure: the first frame is on the display. @param {number} at_ms @param {number} wall_ms of the wall clock */
  begin(at_ms, wall_ms) {
    this.n_presented += 1;
    this.before = { at_ms, n_presented: 1, wall_ms };
    this.isHidden = false;
  }

  /**
   * Looks at a refresh of the display.
   * @param {number} at_ms @param {number} n_presented frames in this exposure @param {number} wall_ms
   * @returns {boolean} whether a frame has come
   */
  refresh(at_ms, n_presented, wall_ms) {
    this.n_refreshes += 1;
    const isNew = n_presented > this.before.n_presented;
    if (isNew) this.#frames(at_ms, n_presented, wall_ms);
    return isNew;
  }

  /** How long there has been no frame: above all in sleep, during which the page's clock may stand, unlike the wall's. @param {number} at_ms @param {number} n_presented in this exposure @param {number} wall_ms */
  gap(at_ms, n_presented, wall_ms) {
    const { before } = this;
    const passed_ms = at_ms - before.at_ms;
    const asleep_ms = wall_ms - before.wall_ms - passed_ms;
    const between_ms = Math.max(0, n_presented - before.n_presented - 1) * this.step_ms; // frames that a busy page missed
    return Math.max(0, passed_ms - between_ms) + (asleep_ms > SLEEP_MS ? asleep_ms : 0);
  }

  /** Ends an exposure. @param {number} at_ms @param {number} n_presented in this exposure @param {number} wall_ms */
  end(at_ms, n_presented, wall_ms) {
    this.#frames(at_ms, n_presented, wall_ms);
  }

  /** @param {number} at_ms @param {number} n_presented @param {number} wall_ms */
  #frames(at_ms, n_presented, wall_ms) {
    const { before } = this;
    const gap_ms = this.gap(at_ms, n_presented, wall_ms);
    const still_ms = Math.min(gap_ms, at_ms - before.at_ms) - Math.max(STILL_MS, LONGEST_STEPS * this.step_ms);
    if (still_ms > 0) this.stills.push({ from_ms: at_ms - still_ms, to_ms: at_ms });
    this.longest_gap_ms = Math.max(this.longest_gap_ms, gap_ms);
    this.n_presented += Math.max(0, n_presented - before.n_presented);
    this.before = { at_ms, n_presented, wall_ms };
    this.isHidden = false;
  }

  /** For how long the film stood still between two times. @param {number} from_ms @param {number} to_ms */
  stillBetween(from_ms, to_ms) {
    return this.stills.reduce((sum, still) => sum + Math.max(0, Math.min(to_ms, still.to_ms) - Math.max(from_ms, still.from_ms)), 0);
  }
}
