/** A canvas whose pixels are those of the display, however the page is zoomed: a picture is neither scaled nor smoothed. */

import { within } from "./patience.js";

const MIDDLE = { x: 0.5, y: 0.4 }; // where pictures stand, above the answers

/** @param {number} length CSS pixels @param {number} [exact] as the browser tells it, except where a display is emulated */
function devicePixels(length, exact) {
  const rounded = Math.round(length * devicePixelRatio);
  return exact !== undefined && Math.abs(exact - rounded) <= 1 ? exact : rounded;
}

export class PixelStage {
  /** @type {ImageBitmap | null} */
  #picture = null;

  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    const observer = new ResizeObserver(([entry]) => this.#resize(entry));
    try {
      observer.observe(canvas, { box: "device-pixel-content-box" });
    } catch {
      observer.observe(canvas); // Safari: its pixel ratios are whole, so rounding is exact
    }
  }

  /** @param {Blob} picture */
  async show(picture) {
    this.#picture = await within(createImageBitmap(picture));
    this.#draw();
  }

  clear() {
    this.#picture = null;
    this.#draw();
  }

  /** @param {ResizeObserverEntry} entry */
  #resize(entry) {
    const [exact] = entry.devicePixelContentBoxSize ?? [];
    const { width, height } = entry.contentRect;
    this.canvas.width = devicePixels(width, exact?.inlineSize);
    this.canvas.height = devicePixels(height, exact?.blockSize);
    this.#draw();
  }

  #draw() {
    const context = this.canvas.getContext("2d", { alpha: false });
    if (!context) throw new Error("this browser has no canvas");
    const { width, height } = this.canvas;
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, width, height);
    if (!this.#picture) return;
    context.imageSmoothingEnabled = false;
    const left = Math.round(MIDDLE.x * width - this.#picture.width / 2);
    const top = Math.round(MIDDLE.y * height - this.#picture.height / 2);
    context.drawImage(this.#picture, left, Math.max(0, top));
  }
}
