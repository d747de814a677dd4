/** The clock of a break: how long it has lasted, and when one may go on. */

import { required } from "./elements.js";
import { fill } from "./page.js";

const TICK_MS = 250;

/**
 * @param {HTMLElement} view of the break, with a clock, a line that says when to go on, and the button that does
 * @param {number} least_s how long it lasts at least; 0: as long as one likes
 * @param {number} rested_s how long it has lasted already, before the page was left
 * @param {(rested_s: number) => void} note told how long it has lasted
 * @returns {() => void} stops the clock
 */
export function startBreak(view, least_s, rested_s, note) {
  const clock = required(HTMLElement, ".clock", view);
  const line = required(HTMLElement, "[data-wait]", view);
  const button = required(HTMLButtonElement, "[data-primary]", view);
  const startedAt = performance.now() - 1000 * rested_s;
  const tick = () => {
    const passed_s = Math.floor((performance.now() - startedAt) / 1000);
    const rest_s = least_s - passed_s;
    clock.textContent = minutesAndSeconds(passed_s);
    line.textContent = rest_s > 0 ? fill(line.dataset.wait, { rest: minutesAndSeconds(rest_s) }) : line.dataset.free ?? "";
    button.disabled = rest_s > 0;
    note(passed_s);
  };
  tick();
  const timer = setInterval(tick, TICK_MS);
  return () => clearInterval(timer);
}

/** @param {number} seconds @returns {string} 1:05 */
function minutesAndSeconds(seconds) {
  return `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
}
