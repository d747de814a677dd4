/** What a trial's screen says besides its films: its label, how far its film has come, and buttons that Enter presses. */

import { required } from "./elements.js";
import { entitle } from "./views.js";
import { after, fill, hasOwnEnter, isPlain } from "./page.js";

const LOADING_IS_TOLD_AFTER_MS = 400;
const PROGRESS_EVERY_MS = 250;

/** Says which trial it is, and how far the study is. @param {HTMLElement} screen @param {import("./session.js").TrialDescription} description */
export function labelTrial(screen, { number, place, total, attempt, is_practice, free_exposure, media }) {
  screen.classList.toggle("is-practice", is_practice);
  screen.classList.toggle("is-free", free_exposure);
  screen.classList.toggle("has-reference", media.reference);
  screen.classList.toggle("is-alone", media.layout === "single");
  for (const element of /** @type {NodeListOf<HTMLElement>} */ (screen.querySelectorAll("[data-label]"))) {
    const { label, labelAgain, labelPractice } = element.dataset;
    const numbered = fill(label, { number: place, total });
    const more = is_practice ? labelPractice : attempt > 1 ? labelAgain : "{label}";
    element.textContent = fill(more, { label: numbered });
  }
  entitle(required(HTMLElement, "h1", screen).textContent ?? "");
  required(HTMLProgressElement, ".progress progress", screen).value = (number - 1) / total;
}

/** Gives a button the focus, and lets Enter press it, too. @param {HTMLButtonElement} button @param {AbortSignal} signal @param {() => void} action */
export function pressedByEnter(button, signal, action) {
  button.focus({ preventScroll: true });
  button.addEventListener("click", action, { signal });
  document.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && !event.repeat && isPlain(event) && !hasOwnEnter(event)) button.click();
  }, { signal });
}

/** Shows how far the loading is, once it lasts. @param {HTMLElement} screen @param {import("./films.js").Film} film @param {AbortSignal} signal */
export function showProgress(screen, film, signal) {
  const loading = required(HTMLElement, ".loading", screen);
  const bar = required(HTMLProgressElement, "progress", loading);
  const left = required(HTMLElement, "[data-left]", loading);
  left.textContent = "";
  loading.classList.remove("is-told");
  bar.value = 0;
  const update = () => {
    loading.classList.add("is-told");
    bar.value = film.size ? film.received / film.size : 0;
    const seconds = Math.ceil(film.secondsLeft);
    if (seconds > 0) left.textContent = fill(left.dataset.left, { seconds });
    after(PROGRESS_EVERY_MS, signal, update);
  };
  after(LOADING_IS_TOLD_AFTER_MS, signal, update);
}
