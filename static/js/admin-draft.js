// A new study's form: it is kept as it is typed, and what the study would be is shown anew. Another way of taking part fills
// in other settings, so that the page is loaded again.

import { LARGEST_KEPT_ALIVE } from "./connection.js";
import { byId, required } from "./elements.js";

const WAITS_MS = 600;
const form = required(HTMLFormElement, "form[data-draft]");
const plan = byId("plan");
let waiting = 0;
let [n_sent, isChanged] = [0, false];

const wayOf = (/** @type {string} */ which) => /** @type {HTMLInputElement | null} */ (form.querySelector(`[name=way]${which}`))?.value;
const way = () => wayOf(":checked");
const rendered = wayOf("[checked]"); // by the server; another may have been chosen before this script was there
const answers = /** @type {HTMLFieldSetElement[]} */ ([...form.querySelectorAll("[data-way]")]);

/** Lets only the chosen platform's answers be asked for. */
const choose = () => answers.forEach((each) => (each.disabled = each.hidden = each.dataset.way !== way()));
choose();

form.addEventListener("input", () => {
  isChanged = true;
  choose();
  clearTimeout(waiting);
  form.inert = way() !== rendered; // until the page is there again: what is typed now would be lost
  waiting = setTimeout(keep, form.inert ? 0 : WAITS_MS);
});
// The plan's choice of films sets the settings below, which are sent; with single films, others have no effect.
plan.addEventListener("change", (event) => {
  const chosen = /** @type {HTMLInputElement} */ (event.target);
  if (chosen.name !== "films-of-pairs") return;
  const field = (/** @type {string} */ name) => /** @type {any} */ (form.elements.namedItem(name));
  field("pair_films").value = chosen.value;
  if (chosen.value === "decoded") {
    const lighter = /** @type {HTMLInputElement} */ (form.querySelector("[name=lighter_films][type=checkbox]"));
    [lighter.checked, field("second_codec").value] = [false, ""];
  }
  form.dispatchEvent(new Event("input"));
});
if (way() !== rendered) form.dispatchEvent(new Event("input"));
addEventListener("pagehide", () => isChanged && keep());
form.addEventListener("submit", () => {
  clearTimeout(waiting);
  isChanged = false; // it is sent, and kept with that
});

async function keep() {
  const number = ++n_sent;
  isChanged = false;
  const state = byId("draft-state");
  try {
    const body = new URLSearchParams(/** @type {any} */ (new FormData(form, null)));
    const keepalive = body.toString().length < LARGEST_KEPT_ALIVE; // it survives the page
    const answer = await fetch(form.dataset.draft ?? "", { method: "POST", body, keepalive });
    if (!answer.ok) throw new Error(String(answer.status));
    const text = await answer.text();
    if (number !== n_sent) return; // a later one is on its way
    if (way() !== rendered) location.replace(form.dataset.again ?? "");
    else plan.innerHTML = text;
    state.textContent = "Kept as you type.";
  } catch {
    isChanged = true;
    form.inert = false;
    state.textContent = "Not kept: the server did not answer. It is tried again with your next change.";
  }
}
