/** Draws a bank card that the participant resizes, by slider, keys, buttons or dragging, until it is as large as a real one. */

import { required } from "./elements.js";

const STEP = 1; // CSS pixels; 2 % of a card are four to ten
const FIRST = { smallest: 220, largest: 420 }; // random each time, so that every fit is made afresh

export class BankCard {
  /** @param {ParentNode} view with the card, its slider and two buttons */
  constructor(view) {
    this.card = required(HTMLElement, ".bank-card", view);
    this.slider = required(HTMLInputElement, "input[type=range]", view);
    this.slider.addEventListener("input", () => this.#set(this.slider.valueAsNumber));
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (view.querySelectorAll("[data-resize]"))) {
      button.addEventListener("click", () => this.#set(this.width + STEP * Number(button.dataset.resize)));
    }
    this.card.addEventListener("pointerdown", (event) => this.#drag(event));
  }

  /** CSS pixels */
  get width() {
    return this.slider.valueAsNumber;
  }

  /** Begins within the window, where its edge can be dragged; the card must be on show. */
  startAnew() {
    const largest = Math.min(FIRST.largest, required(HTMLElement, "#card-fitting").clientWidth);
    this.#set(FIRST.smallest + Math.random() * (largest - FIRST.smallest));
  }

  /** @param {number} width */
  #set(width) {
    this.slider.value = String(width); // keeps it within the slider's ends
    this.card.style.setProperty("--width", `${this.slider.value}px`);
  }

  /** The edge follows the pointer, whichever point of the card it holds. @param {PointerEvent} down */
  #drag(down) {
    const before = this.width;
    this.card.setPointerCapture(down.pointerId);
    const dragging = new AbortController();
    const { signal } = dragging;
    this.card.addEventListener("pointermove", (move) => this.#set(before + move.clientX - down.clientX), { signal });
    for (const end of ["pointerup", "pointercancel"]) this.card.addEventListener(end, () => dragging.abort(), { signal });
  }
}
