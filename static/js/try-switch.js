/** On the instructions: a drawing on which to try the switching, with the keys of a trial. */

import { byId } from "./elements.js";
import { SWITCH_KEYS, fill } from "./page.js";
import { page } from "./views.js";

/** Does nothing where films are shown alone and there is nothing to try. */
export function listenForTries() {
  const drawing = document.getElementById("try");
  if (!drawing) return;
  drawing.addEventListener("click", () => switchTry(drawing));
  document.addEventListener("keydown", (event) => switchTryByKey(event, drawing));
}

/** Changes the drawing, and tells who listens which of the two is shown. @param {HTMLElement} drawing */
function switchTry({ dataset }) {
  dataset.shown = dataset.shown === "a" ? "b" : "a";
  const status = byId("try-status");
  status.textContent = fill(status.dataset.showing, { letter: status.dataset[dataset.shown] });
}

/** @param {KeyboardEvent} event @param {HTMLElement} drawing */
function switchTryByKey(event, drawing) {
  const pressesButton = event.key === " " && event.target instanceof HTMLButtonElement;
  if (page.dataset.showing !== "instructions-2" || !SWITCH_KEYS.has(event.key) || event.repeat || pressesButton) return;
  event.preventDefault();
  switchTry(drawing);
}
