/** Shows one strip of a film that holds A above B, and a reference below. There is one video element, so all come from the same frame. */

/** @typedef {import("./session.js").Shown} Shown */

const FLOAT_ERROR = 1e-6; // pixels; 1095.9999999 of them are 1096
const SHORTEST_LOOP_S = 0.25; // what is left of an exposure after the last whole pass; less would only flash

export class StackedPlayer {
  /** @param {HTMLElement} film the window that crops @param {HTMLVideoElement} video */
  constructor(film, video) {
    this.film = film;
    this.video = video;
    this.strips = { a: 0, b: 1, reference: 2 }; // counted from the top
    /** @type {Shown} */
    this.shown = "a";
    this.loaded = new AbortController();
    this.address = "";
    this.frameTime = NaN; // of the frame that was last given to the screen
    this.before = { frames: 0, dropped: 0 }; // counted by the browser before the film began
    this.stalls = 0;
  }

  /**
   * Resolves when the first frame can be painted.
   * @param {Blob} blob @param {import("./session.js").Media} media @param {Shown} first @param {AbortSignal} signal
   */
  async load(blob, media, first, signal) {
    this.unload();
    this.strips = media.a === "top" ? { a: 0, b: 1, reference: 2 } : { a: 1, b: 0, reference: 2 };
    this.show(first);
    const fit = () => fitToWindow(this.film, media);
    fit();
    window.addEventListener("resize", fit, { signal: this.loaded.signal });
    this.address = URL.createObjectURL(blob);
    this.video.src = this.address;
    await readiness(this.video, signal);
    checkSize(this.video, media);
  }

  unload() {
    this.loaded.abort();
    this.loaded = new AbortController();
    this.video.pause();
    this.video.removeAttribute("src");
    this.video.load();
    if (this.address) URL.revokeObjectURL(this.address);
    this.address = "";
  }

  /** On screen by the next animation frame. @param {Shown} which */
  show(which) {
    this.shown = which;
    this.film.style.setProperty("--strip", String(this.strips[which]));
  }

  /** Seconds into the film, by the last frame on screen; by the player's position where the browser does not tell of frames. */
  get mediaTime() {
    return Number.isNaN(this.frameTime) ? this.video.currentTime : this.frameTime;
  }

  pause() {
    this.video.pause();
  }

  /**
   * Plays the film, over and over if it is shorter than the exposure.
   * @param {number} exposure_s of film, by the film's own clock; Infinity: until the signal comes
   * @param {AbortSignal} signal
   * @returns {Promise<void>} when that much was shown; rejects when the film stands still
   */
  play(exposure_s, signal) {
    const { video } = this;
    const clock = new FilmClock(video.duration, exposure_s);
    this.#followFrames(signal);
    this.#followQuality(signal);
    return new Promise((resolve, reject) => {
      const stillness = new Stillness();
      const tick = (/** @type {number} */ now) => {
        if (signal.aborted) return;
        clock.advance(video.currentTime);
        video.loop = clock.comesAgain;
        if (clock.isOver) resolve();
        else if (stillness.lasts(now, video.currentTime)) reject(new Error("the film stands still"));
        else requestAnimationFrame(tick);
      };
      video.loop = clock.comesAgain;
      video.addEventListener("ended", () => resolve(), { signal });
      video.addEventListener("error", () => reject(video.error), { signal });
      video.addEventListener("pause", () => video.ended || signal.aborted || video.play().catch(reject), { signal }); // a media key
      video.play().catch(reject);
      requestAnimationFrame(tick);
    });
  }

  /** What the browser counts belongs to the element, so it is counted from here. @param {AbortSignal} signal */
  #followQuality(signal) {
    const { video } = this;
    const before = video.getVideoPlaybackQuality();
    this.before = { frames: before.totalVideoFrames, dropped: before.droppedVideoFrames };
    this.stalls = 0;
    let isStalled = false;
    const resumes = () => (isStalled = false);
    video.addEventListener("waiting", () => {
      if (video.seeking || isStalled) return; // the film begins again, which is no wait for data
      isStalled = true;
      this.stalls += 1;
    }, { signal });
    for (const name of ["playing", "timeupdate"]) video.addEventListener(name, resumes, { signal });
  }

  /** Frames decoded, frames not shown, and waits for data since the film began. */
  get quality() {
    const { totalVideoFrames, droppedVideoFrames } = this.video.getVideoPlaybackQuality();
    return {
      n_frames: Math.max(0, totalVideoFrames - this.before.frames),
      n_dropped: Math.max(0, droppedVideoFrames - this.before.dropped),
      n_stalls: this.stalls,
    };
  }

  /** @param {AbortSignal} signal */
  #followFrames(signal) {
    const follow = (/** @type {number} */ _now, /** @type {VideoFrameCallbackMetadata} */ frame) => {
      this.frameTime = frame.mediaTime;
      if (!signal.aborted) this.video.requestVideoFrameCallback(follow);
    };
    this.frameTime = NaN;
    this.video.requestVideoFrameCallback?.(follow);
  }
}

/**
 * Makes the film as large as the window allows, less a fraction of a pixel: the step from the one half to the other is a
 * whole number of the display's pixels. Browsers round it to that, and B would be moved against A by the rest.
 * @param {HTMLElement} film @param {import("./session.js").Media} media
 */
function fitToWindow(film, media) {
  const { width, height, guard_rows } = media;
  const { clientWidth, clientHeight } = /** @type {HTMLElement} */ (film.parentElement);
  const largest = Math.min(clientWidth / width, clientHeight / height);
  const scale = wholePixels(largest * (height + guard_rows), Math.floor) / (height + guard_rows);
  const measures = {
    "--scale": scale,
    "--width": `${width}px`,
    "--height": `${height}px`,
    "--guard-rows": `${guard_rows}px`,
    "--film-height": `${filmHeight(media)}px`,
    "--left": `${wholePixels((clientWidth - scale * width) / 2, Math.round)}px`,
    "--top": `${wholePixels((clientHeight - scale * height) / 2, Math.round)}px`,
  };
  for (const [name, value] of Object.entries(measures)) film.style.setProperty(name, String(value));
}

/** @param {import("./session.js").Media} media @returns {number} pixels */
function filmHeight({ height, guard_rows, reference }) {
  const n_strips = reference ? 3 : 2;
  return n_strips * height + (n_strips - 1) * guard_rows;
}

/** @param {number} length CSS pixels @param {(x: number) => number} round @returns {number} CSS pixels */
function wholePixels(length, round) {
  return round(length * devicePixelRatio + FLOAT_ERROR) / devicePixelRatio;
}

/** Counts the film that was shown, in seconds, over any number of passes. */
export class FilmClock {
  /** @param {number} duration_s of one pass @param {number} exposure_s to be shown in all */
  constructor(duration_s, exposure_s) {
    this.duration_s = duration_s;
    this.exposure_s = exposure_s;
    this.passes = 0;
    this.position_s = 0;
  }

  /** @param {number} position_s of the film now; smaller than before when a new pass has begun */
  advance(position_s) {
    if (position_s < this.position_s) this.passes += 1;
    this.position_s = position_s;
  }

  get isOver() {
    return this.passes * this.duration_s + this.position_s >= this.exposure_s;
  }

  /** Whether another pass follows the present one. */
  get comesAgain() {
    return this.exposure_s - (this.passes + 1) * this.duration_s > SHORTEST_LOOP_S;
  }
}

/** Notices a film that does not move although the screen does. Time in a hidden tab, where nothing is painted, does not count. */
class Stillness {
  static LONGEST_MS = 5000;
  static LONGEST_STEP_MS = 100;
  still_ms = 0;
  last_ms = NaN;
  position_s = NaN;

  /** @param {number} now_ms @param {number} position_s */
  lasts(now_ms, position_s) {
    const step_ms = Math.min(now_ms - this.last_ms, Stillness.LONGEST_STEP_MS) || 0;
    this.still_ms = position_s === this.position_s ? this.still_ms + step_ms : 0;
    this.last_ms = now_ms;
    this.position_s = position_s;
    return this.still_ms > Stillness.LONGEST_MS;
  }
}

/** @param {HTMLVideoElement} video @param {AbortSignal} signal */
function readiness(video, signal) {
  return new Promise((resolve, reject) => {
    video.addEventListener("canplaythrough", resolve, { once: true, signal });
    video.addEventListener("error", () => reject(video.error), { once: true, signal });
  });
}

/** @param {HTMLVideoElement} video @param {import("./session.js").Media} media */
function checkSize(video, media) {
  const rows = filmHeight(media);
  if (video.videoWidth !== media.width || video.videoHeight !== rows) {
    throw new Error(`the film is ${video.videoWidth}x${video.videoHeight}, expected ${media.width}x${rows}`);
  }
}
