/** What the browser tells about the display. */

const N_REFRESHES = 40;

/** @type {number | null} */
let refresh_hz = null;
/** @type {(() => void)[]} */
const waiting = [];
measureRefresh();

export function display() {
  return {
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
