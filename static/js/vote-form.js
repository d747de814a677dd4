/** The form on which participants choose or rate, by mouse or by key; they may change their mind until Next. */

import { required } from "./elements.js";
import { enterFullScreen, hasOwnEnter, isPlain } from "./page.js";
import { areSingleKeysOn } from "./single-keys.js";
import { isSettling, settle } from "./settling.js";

/** @typedef {Pick<import("./session.js").Vote, "choice" | "rating">} Answer a choice, or a rating */

const DIGIT = /^(?:Digit|Numpad)(\d)$/; // keys by their place: on French keyboards digits need the shift key otherwise
const KEY_OF_TEN = "X"; // or what lies in its place on keyboards of other alphabets

/** What keys do to a slider that has not the focus, as browsers do it to one that has. @type {Record<string, (slider: HTMLInputElement) => void>} */
const SLIDER_KEYS = {
  ArrowLeft: (slider) => (isFromRight(slider) ? slider.stepUp() : slider.stepDown()),
  ArrowDown: (slider) => slider.stepDown(),
  ArrowRight: (slider) => (isFromRight(slider) ? slider.stepDown() : slider.stepUp()),
  ArrowUp: (slider) => slider.stepUp(),
  Home: (slider) => (slider.value = slider.min),
  End: (slider) => (slider.value = slider.max),
};

/**
 * @param {HTMLFormElement} form @param {AbortSignal} signal
 * @param {(answer: Answer, n_changes: number) => void} onNext
 */
export function askForAnswer(form, signal, onNext) {
  const hint = required(HTMLElement, ".choose", form);
  const slider = form.querySelector("input[type=range]");
  form.reset();
  hint.textContent = "";
  required(HTMLElement, "legend", form).focus({ preventScroll: true });
  settle(); // a press meant to switch must not choose
  offerFullScreen(form, signal);
  let n_choices = 0;
  let isAnswered = false;
  const answered = () => {
    isAnswered = true;
    hint.textContent = "";
  };
  if (slider instanceof HTMLInputElement) followSlider(form, slider, signal, answered);
  form.addEventListener("change", () => {
    n_choices += 1;
    answered();
  }, { signal });
  form.addEventListener("submit", () => {
    if (isAnswered) onNext(answerOf(form), Math.max(0, n_choices - 1));
    else hint.textContent = hint.dataset.choose ?? "";
  }, { signal });
  document.addEventListener("keydown", (event) => answerByKey(event, form), { signal });
}

/** @param {HTMLFormElement} form @returns {Answer} */
function answerOf(form) {
  const given = new FormData(form);
  if (given.has("rating")) return { rating: Number(given.get("rating")) };
  return { choice: /** @type {Answer["choice"]} */ (given.get("choice")) };
}

/** Shows a slider's value once it was set: moved, or clicked where it stands. @param {HTMLFormElement} form @param {HTMLInputElement} slider @param {AbortSignal} signal @param {() => void} answered */
function followSlider(form, slider, signal, answered) {
  const value = required(HTMLOutputElement, "output", form);
  slider.classList.add("is-unset");
  slider.setAttribute("aria-valuetext", slider.dataset.unset ?? "");
  value.textContent = "–";
  const show = () => {
    slider.classList.remove("is-unset");
    value.textContent = slider.value;
    slider.setAttribute("aria-valuetext", `${slider.value}, ${nameAt(slider)}`);
    answered();
  };
  for (const type of ["input", "click"]) slider.addEventListener(type, show, { signal });
}

/** The grade under which a slider stands. @param {HTMLInputElement} slider */
function nameAt(slider) {
  const names = document.querySelectorAll("#slider-names span");
  const share = (slider.valueAsNumber - Number(slider.min)) / (Number(slider.max) - Number(slider.min));
  return names[Math.min(names.length - 1, Math.floor(share * names.length))]?.textContent ?? "";
}

/** @param {KeyboardEvent} event @param {HTMLFormElement} form */
function answerByKey(event, form) {
  if (!isPlain(event)) return;
  const slider = form.querySelector("input[type=range]");
  if (slider instanceof HTMLInputElement && event.target !== slider && event.key in SLIDER_KEYS) {
    event.preventDefault();
    if (!isSettling()) moveSlider(slider, SLIDER_KEYS[event.key]);
  } else if (event.repeat) {
    return;
  } else if (event.key === "Enter" && !hasOwnEnter(event)) {
    event.preventDefault();
    form.requestSubmit();
  } else {
    chooseByKey(event, form);
  }
}

/** @param {HTMLInputElement} slider @param {(slider: HTMLInputElement) => void} move */
function moveSlider(slider, move) {
  slider.focus({ preventScroll: true });
  move(slider);
  for (const type of ["input", "change"]) slider.dispatchEvent(new Event(type, { bubbles: true }));
}

/** In languages that are written from right to left the lowest grade is on the right. @param {HTMLInputElement} slider */
function isFromRight(slider) {
  return getComputedStyle(slider).direction === "rtl";
}

/** @param {KeyboardEvent} event @param {HTMLFormElement} form */
function chooseByKey({ key, code }, form) {
  if (!areSingleKeysOn()) return;
  const isTen = key.toUpperCase() === KEY_OF_TEN || code === `Key${KEY_OF_TEN}`;
  const shortcut = isTen ? KEY_OF_TEN : DIGIT.exec(code)?.[1];
  const radio = shortcut && form.querySelector(`input[aria-keyshortcuts="${shortcut}"]`);
  if (!(radio instanceof HTMLInputElement)) return;
  radio.focus({ preventScroll: true });
  radio.click();
}

/** @param {HTMLFormElement} form @param {AbortSignal} signal */
function offerFullScreen(form, signal) {
  const button = required(HTMLElement, "[data-fullscreen]", form);
  const update = () => (button.hidden = !document.fullscreenEnabled || document.fullscreenElement !== null);
  update();
  document.addEventListener("fullscreenchange", update, { signal });
  button.addEventListener("click", enterFullScreen, { signal });
}
