/** The form on which participants choose, by mouse or by key; they may change their mind until Next. */

import { required } from "./elements.js";
import { enterFullScreen, isPlain } from "./page.js";
import { settle } from "./settling.js";

/** @typedef {import("./session.js").Vote["choice"]} Choice */

/** Digits by their place: on French keyboards they need the shift key otherwise. @type {Map<string, Choice>} */
const CHOICE_OF_KEY = new Map([
  ["Digit1", "a"], ["Digit2", "none"], ["Digit3", "b"], ["Numpad1", "a"], ["Numpad2", "none"], ["Numpad3", "b"],
]); // prettier-ignore

/**
 * @param {HTMLFormElement} form @param {AbortSignal} signal
 * @param {(choice: Choice, n_changes: number) => void} onNext
 */
export function askForChoice(form, signal, onNext) {
  const hint = required(HTMLElement, ".choose", form);
  form.reset();
  hint.textContent = "";
  required(HTMLElement, "legend", form).focus({ preventScroll: true });
  settle(); // a press meant to switch must not choose
  offerFullScreen(form, signal);
  let n_choices = 0;
  form.addEventListener("change", () => {
    n_choices += 1;
    hint.textContent = "";
  }, { signal });
  form.addEventListener("submit", () => {
    const choice = /** @type {Choice | null} */ (new FormData(form).get("choice"));
    if (choice) onNext(choice, n_choices - 1);
    else hint.textContent = hint.dataset.choose ?? "";
  }, { signal });
  document.addEventListener("keydown", (event) => answerByKey(event, form), { signal });
}

/** @param {KeyboardEvent} event @param {HTMLFormElement} form */
function answerByKey(event, form) {
  if (event.repeat || !isPlain(event)) return;
  const choice = CHOICE_OF_KEY.get(event.code);
  if (choice) {
    const radio = required(HTMLInputElement, `input[value="${choice}"]`, form);
    radio.focus({ preventScroll: true });
    radio.click();
  } else if (event.key === "Enter" && !(event.target instanceof HTMLButtonElement)) {
    event.preventDefault();
    form.requestSubmit();
  }
}

/** @param {HTMLFormElement} form @param {AbortSignal} signal */
function offerFullScreen(form, signal) {
  const button = required(HTMLElement, "[data-fullscreen]", form);
  const update = () => (button.hidden = !document.fullscreenEnabled || document.fullscreenElement !== null);
  update();
  document.addEventListener("fullscreenchange", update, { signal });
  button.addEventListener("click", enterFullScreen, { signal });
}
