/** Shows a strip of a film that holds A above B, and a reference below: with one video element, all come from the same frame. */

import { required } from "./elements.js";
import { fitToPage, stackedHeight, stripsOf } from "./film-window.js";
import { PlaybackCount, attach, checkSize, detach, followFrames, playFor, readiness } from "./playback.js";

/** @typedef {import("./session.js").Shown} Shown */

export class StackedPlayer {
  /** @param {HTMLElement} film the window that crops */
  constructor(film) {
    this.film = film;
    this.video = required(HTMLVideoElement, "video", film);
    this.strips = { a: 0, b: 1, reference: 2 }; // counted from the top
    /** @type {Shown} */
    this.shown = "a";
    this.loaded = new AbortController();
    this.frameTime = NaN; // of the frame that was last given to the screen
    this.presented = 0; // frames given to the screen in the present exposure
    /** @type {PlaybackCount | null} */
    this.count = null;
  }

  /**
   * Resolves when the first frame can be painted.
   * @param {Blob[]} blobs the film @param {import("./session.js").Media} media @param {Shown} first @param {AbortSignal} signal
   */
  async load([blob], media, first, signal) {
    this.unload();
    this.strips = stripsOf(media);
    this.show(first);
    fitToPage(this.film, media, this.loaded.signal);
    attach(this.video, blob);
    await readiness(this.video, signal);
    checkSize(this.video, media.width, stackedHeight(media));
  }

  unload() {
    this.loaded.abort();
    this.loaded = new AbortController();
    detach(this.video);
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

  /** Plays the film until that much was shown. @param {number} exposure_s @param {AbortSignal} signal */
  play(exposure_s, signal) {
    this.frameTime = NaN;
    this.presented = 1; // the first one is on the screen
    let before = NaN;
    followFrames(this.video, signal, (time_s, n_presented) => {
      this.frameTime = time_s;
      this.presented += before < n_presented ? n_presented - before : 1;
      before = n_presented;
    });
    this.count = new PlaybackCount(this.video, signal);
    return playFor(this.video, exposure_s, signal);
  }

  /** Frames that the display got in the exposure; by the browser's count where it does not tell of frames. */
  get n_presented() {
    if (this.presented > 1 || !this.count) return this.presented;
    const { n_frames, n_dropped } = this.count.quality;
    return 1 + n_frames - n_dropped;
  }

  /** The exposure's counts, for the viewing record; both strips come from one frame. */
  get quality() {
    return { ...this.count?.quality, n_mismatches: 0 };
  }
}
