/** Withdrawing: asked first, and then counted down, so that who pressed without reading takes it back. */

import { byId, required } from "./elements.js";
import { fill } from "./page.js";
import { openDialog, page } from "./views.js";

const UNDO_S = 5;
const TICK_MS = 250;

/**
 * @param {(isErasing: boolean) => void} leave for good
 * @param {(isErasing: boolean) => void} leaveAtOnce before the countdown is over, because the page is left
 */
export function offerWithdrawal(leave, leaveAtOnce) {
  const erasing = required(HTMLInputElement, "#withdraw-erase");
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-withdraw]"))) {
    button.addEventListener("click", () => {
      erasing.checked = button.dataset.withdraw === "erase";
      openDialog("withdraw");
    });
  }
  byId("withdraw-yes").addEventListener("click", () => {
    required(HTMLDialogElement, "#withdraw").close();
    countDown(() => leave(erasing.checked), () => leaveAtOnce(erasing.checked));
  });
}

/** @param {() => void} leave @param {() => void} leaveAtOnce */
function countDown(leave, leaveAtOnce) {
  const dialog = openDialog("withdrawing");
  const clock = byId("withdrawing-heading");
  const end = performance.now() + 1000 * UNDO_S;
  const counting = new AbortController();
  const tick = () => {
    const seconds = Math.ceil((end - performance.now()) / 1000);
    if (seconds > 0) {
      clock.textContent = fill(clock.dataset.soon, { seconds });
      return;
    }
    dialog.close();
    leave();
  };
  const timer = setInterval(tick, TICK_MS);
  tick();
  window.addEventListener("pagehide", leaveAtOnce, { signal: counting.signal });
  dialog.addEventListener("close", () => {
    clearInterval(timer);
    counting.abort();
  }, { once: true });
}
