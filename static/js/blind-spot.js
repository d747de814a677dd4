/** Moves a dot away from a cross until it vanishes in the blind spot: the farther from the cross that is, the farther the eye is from the display. */

import { required } from "./elements.js";
import { settle } from "./settling.js";

const START_MM = 30;
const START_RANGE_MM = 25; // random each time, so that nobody answers by the time that passes
const SPEED_MM_S = 20; // slow: answering takes a third of a second, or 7 mm
const CROSS_AT = 0.12; // of the window's width, as the style sheet has it
const FARTHEST_RAD = (16 * Math.PI) / 180; // where the dot vanishes for nearly everybody; for most at 13.5 degrees
const MARGIN_MM = 10; // to the right edge of the window, where the dot begins again

/** Whether the window is wide enough to lose the dot from a distance. @param {number} distance_cm @param {number} cssPixelMm */
export function fitsBlindSpot(distance_cm, cssPixelMm) {
  const offset_mm = 10 * distance_cm * Math.tan(FARTHEST_RAD) + MARGIN_MM;
  return offset_mm <= (1 - CROSS_AT) * window.innerWidth * cssPixelMm;
}

/**
 * @param {HTMLElement} field with a cross and a dot
 * @param {number} cssPixelMm
 * @param {() => boolean} isActive
 * @returns {Promise<number>} CSS pixels from the cross to where the dot vanished
 */
export function watchDot(field, cssPixelMm, isActive) {
  const dot = required(HTMLElement, ".blind-dot", field);
  const cross = required(HTMLElement, ".blind-cross", field);
  return new Promise((resolve) => {
    const watching = new AbortController();
    const { signal } = watching;
    let offset = 0; // mm
    let before = performance.now();
    const restart = () => {
      offset = START_MM + Math.random() * START_RANGE_MM;
    };
    const place = () => dot.style.setProperty("--offset", `${offset / cssPixelMm}px`);
    restart();
    place();
    settle(); // a double click on the dot before this one must not count for both

    const tick = (/** @type {number} */ now) => {
      if (signal.aborted) return;
      if (isActive()) offset += (SPEED_MM_S * Math.max(0, now - before)) / 1000;
      before = now;
      const right = cross.getBoundingClientRect().left + (offset + MARGIN_MM) / cssPixelMm;
      if (right > field.clientWidth) restart();
      place();
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);

    const vanish = () => {
      watching.abort();
      resolve(offset / cssPixelMm);
    };
    field.addEventListener("pointerdown", vanish, { signal });
    document.addEventListener(
      "keydown",
      (event) => {
        if (event.key !== " " || event.repeat || !isActive() || event.target instanceof HTMLButtonElement) return;
        event.preventDefault();
        vanish();
      },
      { signal },
    );
  });
}
