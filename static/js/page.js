/** What every part of the participant's page does with it. */

export const SWITCH_KEYS = new Set([" ", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]);

/** Asks for the full screen, as far as the browser has one; call on a press. */
export function enterFullScreen() {
  if (document.fullscreenElement === null) document.documentElement.requestFullscreen?.().catch(() => {});
}

/** What is filled in goes by request: a form that the browser sends itself leaves the page. @param {Event} event a form's submit */
export function stayOnSubmit(event) {
  const form = /** @type {HTMLFormElement} */ (event.target);
  if (!form.hasAttribute("method")) event.preventDefault();
}

/** @param {ParentNode} parent @param {string} selector @returns {HTMLElement} */
export function find(parent, selector) {
  return /** @type {HTMLElement} */ (parent.querySelector(selector));
}

/** @param {string | undefined} text with {places} @param {Record<string, unknown>} values @returns {string} */
export function fill(text, values) {
  return (text ?? "").replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place));
}

/** @param {number} milliseconds @param {AbortSignal} signal @param {() => void} action not done if the signal comes first */
export function after(milliseconds, signal, action) {
  const timer = setTimeout(action, milliseconds);
  signal.addEventListener("abort", () => clearTimeout(timer), { once: true });
}

/** Whether a key is meant for the page, not for the browser or an open dialog. @param {KeyboardEvent} event */
export function isPlain(event) {
  return !event.ctrlKey && !event.altKey && !event.metaKey && !document.querySelector("dialog[open]");
}
