/** On the instructions: a drawing on which switching is tried, with the keys that will do it in a trial. */

import { SWITCH_KEYS } from "./page.js";
import { byId, page } from "./views.js";

export function listenForTries() {
  byId("try").addEventListener("click", switchTry);
  document.addEventListener("keydown", switchTryByKey);
}

function switchTry() {
  const { dataset } = byId("try");
  dataset.shown = dataset.shown === "a" ? "b" : "a";
}

/** @param {KeyboardEvent} event */
function switchTryByKey(event) {
  const pressesButton = event.key === " " && event.target instanceof HTMLButtonElement;
  if (page.dataset.showing !== "instructions-2" || !SWITCH_KEYS.has(event.key) || event.repeat || pressesButton) return;
  event.preventDefault();
  switchTry();
}
