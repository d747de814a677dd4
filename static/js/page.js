/** What the parts of the participant's page share: full screen, texts, keys and timers. */

export const SWITCH_KEYS = new Set([" ", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"]);

/** Asks for the full screen where the browser has one. Browsers allow it during a press only. */
export function enterFullScreen() {
  if (document.fullscreenElement === null) document.documentElement.requestFullscreen?.().catch(() => {});
}

/** Stops the browser from leaving the page to send a form, which the page sends itself. @param {Event} event a form's submit */
export function stayOnSubmit(event) {
  const form = /** @type {HTMLFormElement} */ (event.target);
  if (!form.hasAttribute("method")) event.preventDefault();
}

/** Fills in the places of a text. @param {string | undefined} text with {places} @param {Record<string, unknown>} values @returns {string} */
export function fill(text, values) {
  return (text ?? "").replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place));
}

/**
 * The form of a plural text that its number asks for in the page's language.
 * @param {Record<string, string>} text forms by their name in Unicode CLDR; `by` is the place whose number counts
 * @param {Record<string, unknown>} values @returns {string}
 */
export function pluralForm(text, values) {
  return text[new Intl.PluralRules(document.documentElement.lang).select(Number(values[text.by]))] ?? text.other;
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

/** Whether what has the focus does something of its own with Enter, as a link does. @param {KeyboardEvent} event */
export function hasOwnEnter({ target }) {
  return target instanceof Element && target.matches("a, button, summary, textarea");
}
