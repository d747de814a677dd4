/** How long the study takes, as the page tells it: in whole minutes. */

/** @typedef {Partial<Record<import("./session.js").Stage, number>>} Minutes of each stage */

/** @param {Minutes} minutes @returns {number} of all stages together: the sum of what is told of each */
export function minutesTogether(minutes) {
  return Object.values(minutes).reduce((sum, stage) => sum + roughly(stage), 0);
}

/** @param {Minutes} minutes @param {{number: number, total: number}} next trial @returns {number} from it to the end, rather too many than too few */
export function minutesLeft({ trial = 0, interview = 0 }, { number, total }) {
  return Math.max(1, Math.ceil(trial * (1 - (number - 1) / total) + interview));
}

/** How many quarters are done with the trial before this one, if that one completed a quarter; else 0. @param {{number: number, total: number}} trial */
export function quarterDone({ number, total }) {
  const quarters = Math.floor((4 * (number - 1)) / total);
  return quarters > Math.floor((4 * (number - 2)) / total) ? Math.max(0, quarters) : 0;
}

/** @param {number} [minutes] of a stage @returns {number} */
export function roughly(minutes = 0) {
  return Math.max(1, Math.round(minutes));
}
