/** Directions by key: numbers as on a number pad, the keys around S, or the arrows, two together for a diagonal. */

import { areSingleKeysOn } from "./single-keys.js";

/** From 0 (right) anticlockwise by 45 degrees; keys by their place, whatever is printed on them. @type {Record<string, number>} */
const BY_PLACE = {
  Numpad6: 0, Numpad9: 1, Numpad8: 2, Numpad7: 3, Numpad4: 4, Numpad1: 5, Numpad2: 6, Numpad3: 7,
  Digit6: 0, Digit9: 1, Digit8: 2, Digit7: 3, Digit4: 4, Digit1: 5, Digit2: 6, Digit3: 7,
  KeyD: 0, KeyE: 1, KeyW: 2, KeyQ: 3, KeyA: 4, KeyZ: 5, KeyX: 6, KeyC: 7,
}; // prettier-ignore
const MIDDLE = new Set(["Numpad5", "Numpad0", "Digit5", "Digit0", "KeyS", "KeyN"]);
/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowLeft: [-1, 0], ArrowDown: [0, -1] };

/**
 * @param {(direction: number | null) => void} onDirection null for the middle
 * @param {() => boolean} isActive otherwise keys mean what they always mean
 * @returns {() => void} stops listening
 */
export function listenForDirections(onDirection, isActive) {
  const listening = new AbortController();
  /** @type {Set<string>} */
  const held = new Set();
  /** @type {Set<string>} */
  const chord = new Set(); // arrows pressed since all were up

  /** @param {KeyboardEvent} event */
  const press = (event) => {
    if (!isActive() || event.ctrlKey || event.altKey || event.metaKey) return;
    if (!(event.code in ARROWS) && !areSingleKeysOn()) return;
    const direction = MIDDLE.has(event.code) ? null : BY_PLACE[event.code];
    if (direction === undefined && !(event.code in ARROWS)) return;
    event.preventDefault();
    if (event.repeat) return;
    if (direction !== undefined) {
      onDirection(direction);
      return;
    }
    held.add(event.code);
    chord.add(event.code);
  };

  /** @param {KeyboardEvent} event */
  const release = (event) => {
    held.delete(event.code);
    if (held.size > 0 || chord.size === 0) return;
    const direction = directionOf(chord);
    chord.clear();
    if (direction !== null && isActive()) onDirection(direction);
  };

  document.addEventListener("keydown", press, { signal: listening.signal });
  document.addEventListener("keyup", release, { signal: listening.signal });
  return () => listening.abort();
}

/** @param {Iterable<string>} arrows @returns {number | null} null where they cancel each other */
function directionOf(arrows) {
  let x = 0;
  let y = 0;
  for (const arrow of arrows) {
    x += ARROWS[arrow][0];
    y += ARROWS[arrow][1];
  }
  return x === 0 && y === 0 ? null : (Math.round(Math.atan2(y, x) / (Math.PI / 4)) + 8) % 8;
}
