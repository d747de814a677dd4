/** What happens to the page while a pair is shown and between two pairs: hidden, in front, full screen, resized. */

/** @typedef {import("./session.js").Happening} Happening */

/** @param {AbortSignal} signal @param {(what: Happening) => void} tell */
export function watchPage(signal, tell) {
  /** @param {EventTarget} target @param {string} type @param {() => Happening} happening */
  const on = (target, type, happening) => target.addEventListener(type, () => tell(happening()), { signal });
  on(document, "visibilitychange", () => (document.visibilityState === "hidden" ? "hidden" : "visible"));
  on(document, "fullscreenchange", () => (document.fullscreenElement ? "full screen" : "full screen left"));
  on(window, "blur", () => "blur");
  on(window, "focus", () => "focus");
  on(window, "resize", () => "resize");
}
