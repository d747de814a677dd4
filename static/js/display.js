/** What the browser says of the display and of what it can play. */

const H264 = 'video/mp4; codecs="avc1.640032"'; // high profile, level 5.0: two stimuli of 1920x1080, one above the other
const N_REFRESHES = 40;

/** @type {number | null} */
let refresh_hz = null;
/** @type {(() => void)[]} */
const waiting = [];
measureRefresh();

/** Where the film is that this browser plays. @param {import("./session.js").Media} media @returns {string} */
export function playable({ url, second }) {
  return second && !plays(H264) ? second.url : url;
}

/** @param {string} type */
function plays(type) {
  return document.createElement("video").canPlayType(type) !== "";
}

/** @param {string} [secondType] of the films that the study has besides H.264 */
export function display(secondType) {
  return {
    canPlay: plays(H264) || Boolean(secondType && plays(secondType)),
    window_width: window.innerWidth,
    window_height: window.innerHeight,
    screen_width: window.screen.width,
    screen_height: window.screen.height,
    device_pixel_ratio: window.devicePixelRatio,
    refresh_hz,
  };
}

/** @param {() => void} callback told once the refresh rate has been measured, unless it is known already */
export function whenRefreshIsKnown(callback) {
  if (refresh_hz === null) waiting.push(callback);
}

/** The median step between animation frames, while the page is read; null until it is known. */
function measureRefresh() {
  /** @type {number[]} */
  const times = [];
  const tick = (/** @type {number} */ now) => {
    times.push(now);
    if (times.length <= N_REFRESHES) {
      requestAnimationFrame(tick);
      return;
    }
    const steps = times.slice(1).map((time, index) => time - times[index]).sort((a, b) => a - b);
    refresh_hz = Math.round(10_000 / steps[steps.length >> 1]) / 10;
    for (const callback of waiting.splice(0)) callback();
  };
  requestAnimationFrame(tick);
}
