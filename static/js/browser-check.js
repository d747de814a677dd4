/** Tells before the study begins whether this browser and window can show it. */

import { display, whenRefreshIsKnown } from "./display.js";
import { fill } from "./page.js";

const SMALLEST_WINDOW = { width: 1000, height: 550 }; // CSS pixels; a laptop's browser with all its bars has more
const SLOWEST_REFRESH_HZ = 45; // a film of 25 frames a second needs about twice as many

/**
 * Shows each check with its value, now and whenever the window changes, and marks what is unfavourable.
 * @param {HTMLElement} list with an item for each check: data-check, data-good, data-fair and data-bad texts
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
  const { window_width, window_height, device_pixel_ratio, refresh_hz } = display();
  const isLarge = window_width >= SMALLEST_WINDOW.width && window_height >= SMALLEST_WINDOW.height;
  const values = { window_width, window_height, scaling_percent: Math.round(device_pixel_ratio * 100), refresh_hz: Math.round(refresh_hz ?? 0) };
  /** @type {Record<string, boolean>} */
  const isGood = { codec: technique !== null && technique !== "two videos", window: isLarge, refresh: refresh_hz === null || refresh_hz >= SLOWEST_REFRESH_HZ, pixels: true };
  for (const item of /** @type {NodeListOf<HTMLElement>} */ (list.querySelectorAll("[data-check]"))) {
    const { check = "", good, fair, bad } = item.dataset;
    item.classList.toggle("is-bad", !isGood[check]);
    item.hidden = check === "refresh" && refresh_hz === null;
    const text = fill(isGood[check] ? good : technique && fair ? fair : bad, values);
    if (item.textContent !== text) item.textContent = text;
  }
}
