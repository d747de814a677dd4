/** The way back to a recruiting platform: the completion code, and the button that the page presses by itself. */

import { required } from "./elements.js";
import { fill } from "./page.js";

let timer = 0;

/**
 * Shows on a view where its participant goes; nothing where the study says nothing of it.
 * @param {HTMLElement} view
 * @param {import("./session.js").Ending | null} ending
 */
export function showEnding(view, ending) {
  clearInterval(timer);
  const place = view.querySelector(".ending");
  if (!(place instanceof HTMLElement) || !ending) return;
  place.hidden = false;
  const code = required(HTMLElement, ".completion", place);
  code.hidden = !ending.code;
  required(HTMLElement, "code", code).textContent = ending.code ?? "";
  if (ending.url) leadBack(place, ending.url, ending.after_s);
}

/** The ending that a view's page holds, of who has no session. @param {HTMLElement} view @returns {import("./session.js").Ending | null} */
export function endingOnPage(view) {
  const { url, afterS } = required(HTMLElement, ".ending", view).dataset;
  return url ? { code: null, url, after_s: Number(afterS) } : null;
}

/** @param {HTMLElement} place @param {string} url @param {number} afterS 0: only by the button */
function leadBack(place, url, afterS) {
  const link = required(HTMLAnchorElement, "a", place);
  const stay = required(HTMLButtonElement, "button", place);
  const soon = required(HTMLElement, "[data-soon]", place);
  link.href = url;
  link.hidden = false;
  stay.hidden = afterS === 0;
  for (const close of place.parentElement?.querySelectorAll("[data-close]") ?? []) close.toggleAttribute("hidden", true);
  if (afterS === 0) return;
  const end = performance.now() + afterS * 1000;
  const tick = () => {
    const seconds = Math.ceil((end - performance.now()) / 1000);
    soon.textContent = fill(soon.dataset.soon, { seconds: Math.max(seconds, 0) });
    if (seconds > 0) return;
    clearInterval(timer);
    location.assign(url);
  };
  timer = window.setInterval(tick, 250);
  tick();
  stay.addEventListener("click", () => {
    clearInterval(timer);
    stay.hidden = true;
    soon.textContent = "";
  });
}
