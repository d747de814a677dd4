/** Tells before the study begins whether this browser and window can show it. */

import { display, whenRefreshIsKnown } from "./display.js";

const SMALLEST_WINDOW = { width: 1000, height: 550 }; // CSS pixels; a laptop's browser with all its bars has more
const SLOWEST_REFRESH_HZ = 45; // a film of 25 frames a second needs about twice as many

/**
 * Shows each check, now and whenever the window changes, and marks what is unfavourable.
 * @param {HTMLElement} list with an item for each check: data-check, data-good and data-bad texts
 * @param {import("./session.js").Technique | null} technique how this browser shows the films; null: it cannot
 */
export function checkBrowser(list, technique) {
  const look = () => tell(list, technique);
  look();
  whenRefreshIsKnown(look);
  window.addEventListener("resize", look);
}

/** @param {HTMLElement} list @param {import("./session.js").Technique | null} technique */
function tell(list, technique) {
  const { window_width, window_height, refresh_hz } = display();
  const isLarge = window_width >= SMALLEST_WINDOW.width && window_height >= SMALLEST_WINDOW.height;
  /** @type {Record<string, boolean>} */
  const isGood = { codec: technique !== null, window: isLarge, refresh: refresh_hz === null || refresh_hz >= SLOWEST_REFRESH_HZ };
  for (const item of /** @type {NodeListOf<HTMLElement>} */ (list.querySelectorAll("[data-check]"))) {
    const { check = "", good, bad } = item.dataset;
    item.classList.toggle("is-bad", !isGood[check]);
    item.hidden = false;
    item.classList.toggle("is-unknown", check === "refresh" && refresh_hz === null);
    const text = (isGood[check] ? good : bad) ?? "";
    if (item.textContent !== text) item.textContent = text;
  }
}
