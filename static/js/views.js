/** The views of the participant's page, of which one is shown at a time, and the values in their texts. */

import { byId, required } from "./elements.js";
import { fill, hasOwnEnter, pluralForm } from "./page.js";
import { settle } from "./settling.js";

export const page = byId("study");

/** @type {Record<string, unknown>} */
let told = {};
let isOver = false;
const study = document.title; // before a view gives its own

/** @param {Record<string, unknown>} values for the places in the texts */
export function tell(values) {
  told = { ...told, ...values };
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-fill]"))) {
    place.textContent = fill(place.dataset.fill, told);
  }
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-fill-plural]"))) {
    place.textContent = fill(pluralForm(JSON.parse(place.dataset.fillPlural ?? ""), told), told);
  }
}

/** @param {string} name of the one view that is shown now */
export function show(name) {
  if (!isOver) change(name);
}

/** Shows a view that no later one replaces: the study is over on this page. @param {string} name */
export function showAtTheEnd(name) {
  isOver = true;
  change(name);
}

/** Names the window after what is shown. @param {string} heading */
export function entitle(heading) {
  document.title = heading ? `${heading} – ${study}` : study;
}

/** @param {string} name */
function change(name) {
  settle();
  for (const view of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-view]"))) {
    view.hidden = view.dataset.view !== name;
  }
  page.dataset.showing = name;
  page.querySelector("#leave")?.toggleAttribute("hidden", !("mayLeave" in viewOf(name).dataset));
  const isDim = "dim" in viewOf(name).dataset; // no bright page between two films
  page.className = name === "trial" ? "dark" : isDim ? "light dim" : "light";
  window.scrollTo(0, 0);
  const first = viewOf(name).querySelector("form:not([hidden]) [data-first]"); // where one types
  const heading = /** @type {HTMLElement | null} */ (viewOf(name).querySelector('h1[tabindex="-1"]'));
  entitle(heading?.textContent ?? "");
  if (first instanceof HTMLInputElement) first.select();
  else heading?.focus({ preventScroll: true });
}

/** Enter presses a page's main button, unless what has the focus takes it. @param {KeyboardEvent} event */
export function pressPrimary(event) {
  if (event.key !== "Enter" || event.repeat || hasOwnEnter(event) || isDialogOpen()) return;
  const button = page.querySelector(`[data-view="${page.dataset.showing}"] [data-primary]`);
  if (!(button instanceof HTMLElement) || button.hidden) return;
  event.preventDefault();
  button.click();
}

/** Opens a dialog over the view. @param {string} id @returns {HTMLDialogElement} */
export function openDialog(id) {
  const dialog = required(HTMLDialogElement, `#${id}`);
  settle();
  dialog.addEventListener("close", settle, { once: true });
  dialog.showModal();
  return dialog;
}

export function isDialogOpen() {
  return document.querySelector("dialog[open]") !== null;
}

/** @param {string} name @returns {HTMLElement} */
export function viewOf(name) {
  return required(HTMLElement, `[data-view="${name}"]`, page);
}
