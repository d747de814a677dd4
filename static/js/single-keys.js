/** Whether single keys act, such as 1 or R: who speaks to the computer presses some by mistake, and switches them off (WCAG 2.1.4). */

import { inBrowser } from "./remembered.js";

const KEPT_AS = "single keys";
const OFF = "off";

export function areSingleKeysOn() {
  return inBrowser.get(KEPT_AS) !== OFF;
}

/** @param {ParentNode} page with a box to tick on each view that tells of such keys */
export function offerSingleKeys(page) {
  const boxes = /** @type {NodeListOf<HTMLInputElement>} */ (page.querySelectorAll("[data-single-keys]"));
  for (const box of boxes) {
    box.checked = areSingleKeysOn();
    box.addEventListener("change", () => {
      inBrowser.set(KEPT_AS, box.checked ? "on" : OFF);
      for (const other of boxes) other.checked = box.checked;
    });
  }
}
