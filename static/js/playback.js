/** Plays a video element for an exposure: its clock, a film that stands still, and the browser's counts of frames. */

import { after } from "./page.js";

export const FIRST_PICTURE_MS = 10_000; // patience with a decoder that gives out nothing
const SHORTEST_LOOP_S = 0.25; // least rest of an exposure for which the film begins again: a shorter one would only flash

/**
 * Plays a film, over and over if it is shorter than the exposure.
 * @param {HTMLVideoElement} video
 * @param {number} exposure_s of film; Infinity: until the signal comes
 * @param {AbortSignal} signal
 * @returns {Promise<void>} when that much was shown; rejects when the film stands still
 */
export function playFor(video, exposure_s, signal) {
  const clock = new FilmClock(video.duration, exposure_s);
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
    video.addEventListener("error", () => reject(whyNotShown(video)), { signal });
    video.addEventListener("pause", () => video.ended || signal.aborted || video.play().catch(reject), { signal }); // a media key
    video.play().catch(reject);
    requestAnimationFrame(tick);
  });
}

export const UNDECODED = "the film is damaged, or the browser cannot decode it";
const FAULTS = ["the film cannot be shown", "the film was stopped", "the film did not come", UNDECODED, "the film is none that the browser plays"]; // by MediaError.code

/** Says in words why an element cannot show its film, then after a colon the browser's own text: some browsers have none. @param {HTMLVideoElement} video */
export function whyNotShown({ error }) {
  return new Error([FAULTS[error?.code ?? 0], error?.message].filter(Boolean).join(": "));
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
export class Stillness {
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

/** Frames and stalls since the exposure began; the browser itself counts since the element was made. */
export class PlaybackCount {
  /** @param {HTMLVideoElement} video @param {AbortSignal} signal the end of the exposure */
  constructor(video, signal) {
    this.video = video;
    this.before = video.getVideoPlaybackQuality();
    this.n_stalls = 0;
    let isStalled = false;
    const resumes = () => (isStalled = false);
    video.addEventListener("waiting", () => {
      if (video.seeking || isStalled) return; // the film begins again, which is no wait for data
      isStalled = true;
      this.n_stalls += 1;
    }, { signal });
    for (const name of ["playing", "timeupdate"]) video.addEventListener(name, resumes, { signal });
  }

  /** Frames decoded, frames not shown, and waits for data. */
  get quality() {
    const { totalVideoFrames, droppedVideoFrames } = this.video.getVideoPlaybackQuality();
    return {
      n_frames: Math.max(0, totalVideoFrames - this.before.totalVideoFrames),
      n_dropped: Math.max(0, droppedVideoFrames - this.before.droppedVideoFrames),
      n_stalls: this.n_stalls,
    };
  }
}

/** Resolves when an element can show its film, all of which is in memory: not every browser says by itself that it can play it through. @param {HTMLVideoElement} video @param {AbortSignal} signal */
export function readiness(video, signal) {
  return new Promise((resolve, reject) => {
    after(FIRST_PICTURE_MS, signal, () => reject(new Error("the browser does not say that the film can play")));
    video.addEventListener("canplay", resolve, { once: true, signal });
    video.addEventListener("error", () => reject(whyNotShown(video)), { once: true, signal });
  });
}

/** Tells of a frame that an element gives to the screen, in seconds of its film (Firefox counts on when it begins again), and how many it has given in all: a busy page is not told of each. @param {HTMLVideoElement} video @param {AbortSignal} signal @param {(time_s: number, n_presented: number) => void} tell */
export function followFrames(video, signal, tell) {
  const follow = (/** @type {number} */ _now, /** @type {VideoFrameCallbackMetadata} */ frame) => {
    tell((microseconds(frame.mediaTime) % microseconds(video.duration)) / 1e6, frame.presentedFrames);
    if (!signal.aborted) video.requestVideoFrameCallback(follow);
  };
  video.requestVideoFrameCallback?.(follow);
}

/** Whole ones, whose remainder has no rounding error. @param {number} time_s */
function microseconds(time_s) {
  return Math.round(1e6 * time_s);
}

/** @param {HTMLVideoElement} video @param {number} width @param {number} height */
export function checkSize(video, width, height) {
  if (video.videoWidth !== width || video.videoHeight !== height) {
    throw new Error(`the film is ${video.videoWidth}x${video.videoHeight}, expected ${width}x${height}`);
  }
}

/** Shows a file that is in memory. @param {HTMLVideoElement} video @param {Blob} blob */
export function attach(video, blob) {
  video.src = URL.createObjectURL(blob);
}

/** Takes the file away again, and frees its memory. @param {HTMLVideoElement} video */
export function detach(video) {
  const address = video.src;
  video.pause();
  video.removeAttribute("src");
  video.load();
  if (address) URL.revokeObjectURL(address);
}
