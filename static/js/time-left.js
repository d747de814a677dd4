/** How long the study takes, as the page tells it: in whole minutes, rather too many than too few. */

/** @typedef {Partial<Record<import("./session.js").Stage, number>>} Minutes of each stage */

/** @param {Minutes} minutes @returns {number} of all stages together */
export function minutesTogether(minutes) {
  return Math.ceil(sum(Object.values(minutes)));
}

/** @param {Minutes} minutes @param {{number: number, total: number}} next trial @returns {number} from it to the end */
export function minutesLeft({ trial = 0, interview = 0 }, { number, total }) {
  return Math.max(1, Math.ceil(trial * (1 - (number - 1) / total) + interview));
}

/** @param {number} [minutes] of a stage @returns {number} */
export function roughly(minutes = 0) {
  return Math.max(1, Math.round(minutes));
}

/** @param {number[]} values */
function sum(values) {
  return values.reduce((total, value) => total + value, 0);
}
