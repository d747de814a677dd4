/** The views of the participant's page, of which one is shown at a time, and the values in their texts. */

import { fill } from "./page.js";

export const page = byId("study");

/** @type {Record<string, unknown>} */
let told = {};
let isOver = false;

/** @param {Record<string, unknown>} values for the places in the texts */
export function tell(values) {
  told = { ...told, ...values };
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-fill]"))) {
    place.textContent = fill(place.dataset.fill, told);
  }
}

/** @param {string} name of the one view that is shown now */
export function show(name) {
  if (!isOver) change(name);
}

/** Shows a view that what is still under way does not replace. @param {string} name */
export function showAtTheEnd(name) {
  isOver = true;
  change(name);
}

/** @param {string} name */
function change(name) {
  for (const view of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-view]"))) {
    view.hidden = view.dataset.view !== name;
  }
  page.dataset.showing = name;
  page.className = name === "trial" ? "dark" : "light";
  window.scrollTo(0, 0);
  /** @type {HTMLElement | null} */ (viewOf(name).querySelector('h1[tabindex="-1"]'))?.focus({ preventScroll: true });
}

/** Enter presses a page's main button, wherever the focus is. @param {KeyboardEvent} event */
export function pressPrimary(event) {
  const hasOwnEnter = event.target instanceof HTMLButtonElement || event.target instanceof HTMLTextAreaElement;
  if (event.key !== "Enter" || event.repeat || hasOwnEnter || dialog().open) return;
  const button = /** @type {HTMLElement | null} */ (viewOf(page.dataset.showing ?? "")?.querySelector("[data-primary]"));
  if (!button || button.hidden) return;
  event.preventDefault();
  button.click();
}

/** That asks whether somebody wants to withdraw. */
export function dialog() {
  return /** @type {HTMLDialogElement} */ (byId("withdraw"));
}

/** @param {string} name @returns {HTMLElement} */
export function viewOf(name) {
  return /** @type {HTMLElement} */ (page.querySelector(`[data-view="${name}"]`));
}

/** @param {string} id @returns {HTMLElement} */
export function byId(id) {
  return /** @type {HTMLElement} */ (document.getElementById(id));
}
