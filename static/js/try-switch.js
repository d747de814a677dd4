/** On the instructions: a drawing on which to try the switching, with the keys of a trial. */

import { byId } from "./elements.js";
import { SWITCH_KEYS } from "./page.js";
import { page } from "./views.js";

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
