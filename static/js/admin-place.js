// Keeps the reader's place in a part of a page that is replaced by a newer one: what is scrolled, unfolded and in focus.
// A log follows its end for a reader who is there; for others it stands still, and so does what they read.

/**
 * @typedef {object} Place of something that scrolls
 * @property {number} left
 * @property {number} top
 * @property {string | null} held text of a log that is read before its end
 */

const ROUNDED = 1; // CSS pixels; positions are fractions where a page is zoomed

/** @type {Map<string, Place>} */
const places = new Map();
/** @type {Map<string, boolean>} */
const open = new Map(); // what the reader has unfolded or folded, by id
let inFocus = "";

/** @returns {NodeListOf<HTMLElement>} */
const scrolling = () => document.querySelectorAll("main [tabindex='0'][aria-label]");
/** @returns {NodeListOf<HTMLDetailsElement>} */
const foldable = () => document.querySelectorAll("details[id]");

/** @param {Element} element */
export function isAtEnd({ scrollTop, clientHeight, scrollHeight }) {
  return scrollTop + clientHeight >= scrollHeight - ROUNDED;
}

/** @param {Element} element @returns {string} what tells it from others, also in a newer part; empty: nothing does */
function keyOf(element) {
  if (element.tagName === "SUMMARY") return `summary of ${element.parentElement?.id}`;
  return element.id || element.getAttribute("aria-label") || element.getAttribute("href") || "";
}

function remember() {
  inFocus = document.activeElement ? keyOf(document.activeElement) : "";
  for (const details of foldable()) open.set(details.id, details.open);
  for (const element of scrolling()) {
    const held = element.matches(".log") && !isAtEnd(element) ? element.textContent : null;
    const { scrollLeft: left, scrollTop: top } = element;
    places.set(keyOf(element), { left, top, held });
  }
}

function restore() {
  for (const details of foldable()) details.open = open.get(details.id) ?? details.open;
  for (const element of scrolling()) {
    const place = places.get(keyOf(element));
    if (place?.held) element.textContent = place.held;
    if (element.matches(".log") && !place?.held) element.scrollTop = element.scrollHeight;
    else if (place) element.scrollTo(place.left, place.top);
  }
  if (!inFocus || document.activeElement !== document.body) return;
  const focusable = [.../** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("main :is(a, summary, [tabindex])"))];
  focusable.find((element) => keyOf(element) === inFocus)?.focus({ preventScroll: true });
}

for (const before of ["htmx:beforeSwap", "htmx:sseBeforeMessage"]) document.addEventListener(before, remember);
document.addEventListener("htmx:afterSwap", restore);
