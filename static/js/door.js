/** Tells before the study begins what keeps this device from it: nobody starts what cannot be shown. */

/**
 * @typedef {"phone" | "screen" | "full_screen"} Obstacle
 * @typedef {Obstacle | "films" | "cookies"} Lack what keeps somebody from the study
 */

const LARGEST_TABLET = 1050; // CSS pixels of the shorter side; no tablet on the market has more (13 inch: 1032)

/**
 * @param {DOMStringMap} study phones, fullScreen, minimumWindow and filmSize, as the study's page holds them
 * @returns {Obstacle | null}
 */
export function obstacleOf({ phones = "true", fullScreen, minimumWindow = "[]", filmSize = "[]" }) {
  if (!JSON.parse(phones) && isPhoneOrTablet()) return "phone";
  if (fullScreen === "required" && !document.fullscreenEnabled) return "full_screen";
  const [leastWidth = 0, leastHeight = 0] = JSON.parse(minimumWindow);
  const [filmWidth = 0, filmHeight = 0] = JSON.parse(filmSize); // the display's own pixels
  const { width, height } = window.screen;
  const isWide = width >= leastWidth && Math.ceil(width * devicePixelRatio) >= filmWidth;
  const isHigh = height >= leastHeight && Math.ceil(height * devicePixelRatio) >= filmHeight;
  return isWide && isHigh ? null : "screen";
}

/** Whether this browser takes cookies, by which the server knows a session again; some that refuse them say otherwise. */
export function keepsCookies() {
  const cookie = "cookies=kept";
  document.cookie = `${cookie}; SameSite=Lax`;
  const isKept = document.cookie.split("; ").includes(cookie);
  document.cookie = `${cookie}; Max-Age=0; SameSite=Lax`;
  return isKept;
}

/** Whether it is handled by fingers alone, and small. */
function isPhoneOrTablet() {
  const isTouched = matchMedia("(pointer: coarse)").matches && !matchMedia("(any-pointer: fine)").matches;
  return isTouched && Math.min(window.screen.width, window.screen.height) <= LARGEST_TABLET;
}
