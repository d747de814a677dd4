/** The window in which a film is seen: as large as the screen allows, in whole pixels, or pixel by pixel. */

/** @typedef {import("./session.js").Media} Media */

const FLOAT_ERROR = 1e-6; // pixels; 1095.9999999 of them are 1096

/** The strips of a film from the top, under the labels of a trial. @param {Media} media @returns {Record<import("./session.js").Shown, number>} */
export function stripsOf(media) {
  if (media.layout === "single") return { a: 0, b: 0, reference: 0 };
  return media.a === "top" ? { a: 0, b: 1, reference: 2 } : { a: 1, b: 0, reference: 2 };
}

/**
 * Keeps the film as large as the page allows, less a fraction of a pixel, so that the step from one strip to the next is a
 * whole number of the display's pixels. Browsers round it to that; B would otherwise be shifted against A. The window ends
 * at a whole pixel, too: the lowest strip has nothing below it that would fill up another. Where the study wants it 1:1, a
 * pixel of the film is a pixel of the display, however the page is zoomed.
 * @param {HTMLElement} film @param {Media} media @param {AbortSignal} signal
 */
export function fitToPage(film, media, signal) {
  const fit = () => fitOnce(film, media);
  fit();
  window.addEventListener("resize", fit, { signal });
}

/** @param {HTMLElement} film @param {Media} media */
function fitOnce(film, media) {
  const { width, height, guard_rows, pixels } = media;
  const { clientWidth, clientHeight } = /** @type {HTMLElement} */ (film.parentElement);
  const largest = Math.min(clientWidth / width, clientHeight / height);
  const fitting = wholePixels(largest * (height + guard_rows), Math.floor) / (height + guard_rows);
  const scale = pixels === "1:1" ? 1 / devicePixelRatio : fitting;
  const measures = {
    "--scale": scale,
    "--width": `${width}px`,
    "--height": `${height}px`,
    "--guard-rows": `${guard_rows}px`,
    "--film-height": `${stackedHeight(media)}px`,
    "--window-height": `${wholePixels(scale * height, Math.floor)}px`,
    "--left": `${wholePixels((clientWidth - scale * width) / 2, Math.round)}px`,
    "--top": `${wholePixels((clientHeight - scale * height) / 2, Math.round)}px`,
  };
  for (const [name, value] of Object.entries(measures)) film.style.setProperty(name, String(value));
}

/** Whether a film cannot be shown as the study wants. @param {HTMLElement} screen from edge to edge of the window @param {Media} media @param {number[]} least width and height, CSS pixels; empty: any @returns {boolean} */
export function isTooSmallFor(screen, { width, height, pixels }, [leastWidth = 0, leastHeight = 0]) {
  const room = screen.getBoundingClientRect();
  const scale = pixels === "1:1" ? 1 / devicePixelRatio : 0;
  const needed = [Math.max(leastWidth, scale * width), Math.max(leastHeight, scale * height)];
  return room.width + FLOAT_ERROR < needed[0] || room.height + FLOAT_ERROR < needed[1];
}

/** The height of a film that holds all strips. @param {Media} media @returns {number} pixels */
export function stackedHeight({ layout, height, guard_rows, reference }) {
  const n_strips = layout === "single" ? 1 : reference ? 3 : 2;
  return n_strips * height + (n_strips - 1) * guard_rows;
}

/** @param {number} length CSS pixels @param {(x: number) => number} round @returns {number} CSS pixels */
function wholePixels(length, round) {
  return round(length * devicePixelRatio + FLOAT_ERROR) / devicePixelRatio;
}
