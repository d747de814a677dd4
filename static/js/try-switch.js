/** On the instructions: a drawing on which to try the switching, with the keys of a trial. */

import { SWITCH_KEYS } from "./page.js";
import { page } from "./views.js";

/** Does nothing where films are shown alone and there is nothing to try. */
export function listenForTries() {
  const drawing = document.getElementById("try");
  if (!drawing) return;
  drawing.addEventListener("click", () => switchTry(drawing));
  document.addEventListener("keydown", (event) => switchTryByKey(event, drawing));
}

/** @param {HTMLElement} drawing */
function switchTry({ dataset }) {
  dataset.shown = dataset.shown === "a" ? "b" : "a";
}

/** @param {KeyboardEvent} event @param {HTMLElement} drawing */
function switchTryByKey(event, drawing) {
  const pressesButton = event.key === " " && event.target instanceof HTMLButtonElement;
  if (page.dataset.showing !== "instructions-2" || !SWITCH_KEYS.has(event.key) || event.repeat || pressesButton) return;
  event.preventDefault();
  switchTry(drawing);
}
