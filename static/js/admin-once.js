// Sends a form that changes something only once: a second click before the answer would make the change twice.

const WAITS_MS = 10_000; // then the answer is taken for lost

/** @type {WeakMap<EventTarget, number>} */
let sentAt = new WeakMap();

document.addEventListener("submit", (event) => {
  const form = /** @type {HTMLFormElement} */ (event.target);
  if (form.method !== "post") return;
  if (performance.now() - (sentAt.get(form) ?? -Infinity) < WAITS_MS) event.preventDefault();
  else sentAt.set(form, performance.now());
});
window.addEventListener("pageshow", () => (sentAt = new WeakMap())); // back on this page, it may be sent again
