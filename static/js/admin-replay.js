// Replays a trial: its videos run side by side; the one that was on screen at that time is marked, and so is the time.

import { byId, required } from "./elements.js";

/** @param {HTMLElement} replay @param {HTMLInputElement} time over a line with a bar for each look at a video, seconds */
function play(replay, time) {
  const now = required(SVGLineElement, "#replay-now");
  const button = byId("replay-play");
  const videos = [...replay.querySelectorAll("video")];
  const shownMs = Number(replay.dataset.shownMs);
  const durationS = Number(replay.dataset.filmS);
  const looks = [.../** @type {NodeListOf<SVGRectElement>} */ (replay.querySelectorAll("rect.look"))].map((look) => ({
    label: look.dataset.label, // a, b or reference
    from: look.x.baseVal.value / 1000,
    to: (look.x.baseVal.value + look.width.baseVal.value) / 1000,
  }));
  let at = 0; // part of the exposure
  /** @type {number | null} */
  let startedAt = null; // performance.now() at which `at` was 0; null while it stands still

  const show = () => {
    now.setAttribute("x1", String(1000 * at));
    now.setAttribute("x2", String(1000 * at));
    time.value = String(at * Number(time.max));
    const shown = looks.find(({ from, to }) => at >= from && at < to) ?? looks.at(-1);
    for (const figure of replay.querySelectorAll("figure"))
      figure.classList.toggle("is-on-screen", figure.dataset.label === shown?.label);
  };
  const stop = () => {
    startedAt = null;
    for (const video of videos) video.pause();
    button.textContent = at >= 1 ? "Play again" : "Play";
  };
  const step = (/** @type {number} */ now_ms) => {
    if (startedAt === null) return;
    at = Math.min(1, (now_ms - startedAt) / shownMs);
    show();
    if (at >= 1) stop();
    else requestAnimationFrame(step);
  };
  const seek = (/** @type {number} */ part) => {
    at = part;
    for (const video of videos) video.currentTime = ((at * shownMs) / 1000) % durationS;
    show();
  };

  button.addEventListener("click", async () => {
    if (startedAt !== null) return stop();
    if (at >= 1) seek(0);
    const playing = await Promise.all(videos.map((video) => video.play())).catch(() => null);
    byId("replay-fault").hidden = playing !== null;
    if (!playing) return stop();
    startedAt = performance.now() - at * shownMs;
    button.textContent = "Pause";
    requestAnimationFrame(step);
  });
  time.addEventListener("input", () => {
    stop();
    seek(Number(time.value) / Number(time.max));
  });
  for (const video of videos) video.loop = true;
  show();
}

const time = document.querySelector("#replay-seek"); // absent for a trial without a viewing record
if (time instanceof HTMLInputElement) play(byId("replay"), time);
