/**
 * Ignores presses for a moment after what is on the page has changed, so that the second click of a double click never
 * presses what has come to lie under it. The style sheet keeps the pointer away meanwhile; the keys are stopped here.
 */

const SETTLING_MS = 400; // most double clicks take less
const PRESSING_KEYS = new Set(["Enter", " "]);

const root = document.documentElement;
let timer = 0;
let isPointerDown = false;

/** Begins to ignore presses: until the pointer is released, and for `SETTLING_MS` at least. */
export function settle() {
  root.dataset.settling = "";
  clearTimeout(timer);
  timer = window.setTimeout(() => {
    timer = 0;
    end();
  }, SETTLING_MS);
}

export function isSettling() {
  return "settling" in root.dataset;
}

/** Ends the settling, unless its time is not over or the pointer is still down. */
function end() {
  if (timer === 0 && !isPointerDown) delete root.dataset.settling;
}

for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) {
  window.addEventListener(
    type,
    (event) => {
      isPointerDown = /** @type {PointerEvent} */ (event).buttons !== 0;
      if (!isPointerDown) window.setTimeout(end); // after the click that follows a release at once
    },
    { capture: true },
  );
}
for (const type of ["keydown", "keyup"]) {
  window.addEventListener(
    type,
    (event) => {
      if (!isSettling() || !PRESSING_KEYS.has(/** @type {KeyboardEvent} */ (event).key)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
    },
    { capture: true },
  );
}
