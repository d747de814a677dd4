// Rows of a form, such as a study's questions: buttons to add one, move it and delete it. Without this script the page has
// one empty row, and a row without a name is left out.

import { required } from "./elements.js";

for (const list of document.querySelectorAll("fieldset[data-rows]:not([disabled])")) prepare(list);

/** @param {Element} list */
function prepare(list) {
  const blank = list.querySelector("[data-new]");
  for (const row of list.querySelectorAll("[data-row]:not([data-new])")) addButtons(row);
  if (!blank) return;
  blank.remove();
  blank.removeAttribute("data-new");
  const add = button("Add a row", () => {
    const row = /** @type {Element} */ (blank.cloneNode(true));
    addButtons(row);
    add.before(row);
    required(HTMLInputElement, "input", row).focus();
  });
  list.append(add);
}

/** @param {Element} row */
function addButtons(row) {
  const actions = document.createElement("div");
  actions.className = "actions";
  actions.append(
    button("Up", () => {
      const before = row.previousElementSibling;
      if (before?.hasAttribute("data-row")) row.after(before); // the row itself stays where it is, and its button in focus
    }),
    button("Down", () => {
      const after = row.nextElementSibling;
      if (after?.hasAttribute("data-row")) row.before(after);
    }),
    button("Delete", () => {
      const next = row.nextElementSibling; // a row, or the button that adds one
      row.remove();
      /** @type {HTMLElement | null | undefined} */ (next?.querySelector("input") ?? next)?.focus();
    }),
  );
  row.append(actions);
}

/** @param {string} text @param {() => void} act @returns {HTMLButtonElement} */
function button(text, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "button button-small";
  made.textContent = text;
  made.addEventListener("click", () => {
    const list = made.closest("fieldset");
    act();
    list?.dispatchEvent(new Event("input", { bubbles: true })); // a change, as typing is
  });
  return made;
}
