/** The consent: it can be ticked once its end was on the screen, and what is lacking is said when one goes on. */

import { required } from "./elements.js";

const SHARE_SEEN = 0.9; // of the last line, not under the foot

/** @param {HTMLFormElement} form below the document */
export function watchReading(form) {
  const tick = required(HTMLInputElement, "[name=agreed]", form);
  const last = form.previousElementSibling;
  if (!last) throw new Error("there is nothing to read before the consent's form");
  tick.disabled = true;
  const watching = new IntersectionObserver((seen) => {
    if (!seen.some(({ isIntersecting }) => isIntersecting)) return;
    watching.disconnect();
    tick.disabled = false;
    tell(form, "");
  }, { threshold: SHARE_SEEN, rootMargin: "0px 0px -64px" });
  watching.observe(last);
  tick.addEventListener("change", () => tell(form, ""));
}

/** Whether it was read and ticked; else says what is lacking. @param {HTMLFormElement} form */
export function isAgreed(form) {
  const tick = required(HTMLInputElement, "[name=agreed]", form);
  if (tick.checked) return true;
  tell(form, tick.disabled ? "unread" : "unticked");
  if (!tick.disabled) tick.focus();
  return false;
}

/** @param {HTMLFormElement} form @param {"unread" | "unticked" | ""} lack */
function tell(form, lack) {
  const complaint = required(HTMLElement, ".complaint", form);
  required(HTMLInputElement, "[name=agreed]", form).setAttribute("aria-invalid", String(lack === "unticked"));
  complaint.textContent = lack && (complaint.dataset[lack] ?? "");
}
