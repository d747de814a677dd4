/** Shows A and B by a video element each, as a last resort: started together they may still be a frame apart, which is counted. */

import { fitToPage, stripsOf } from "./film-window.js";
import { PlaybackCount, attach, checkSize, detach, followFrames, playFor, readiness } from "./playback.js";

/** @typedef {import("./session.js").Shown} Shown */

export class TwinPlayer {
  /** @param {HTMLElement} film the window */
  constructor(film) {
    this.film = film;
    /** @type {HTMLVideoElement[]} one for each strip, from the top */
    this.videos = [];
    this.strips = { a: 0, b: 1, reference: 2 };
    /** @type {Shown} */
    this.shown = "a";
    this.loaded = new AbortController();
    this.fps = NaN;
    /** @type {number[]} seconds: of the frame that each gave to the screen last */
    this.frameTimes = [];
    this.n_mismatches = 0;
    /** @type {PlaybackCount | null} */
    this.count = null;
  }

  /**
   * Resolves when the first frame of every film can be painted.
   * @param {Blob[]} blobs strip by strip @param {import("./session.js").Media} media @param {Shown} first @param {AbortSignal} signal
   */
  async load(blobs, media, first, signal) {
    this.unload();
    this.strips = stripsOf(media);
    this.fps = media.fps;
    this.videos = blobs.map(() => newVideo(this.film));
    this.show(first);
    fitToPage(this.film, media, this.loaded.signal);
    blobs.forEach((blob, strip) => attach(this.videos[strip], blob));
    await Promise.all(this.videos.map((video) => readiness(video, signal)));
    for (const video of this.videos) checkSize(video, media.width, media.height);
  }

  unload() {
    this.loaded.abort();
    this.loaded = new AbortController();
    for (const video of this.videos.splice(0)) {
      detach(video);
      video.remove();
    }
  }

  /** @param {Shown} which */
  show(which) {
    this.shown = which;
    this.videos.forEach((video, strip) => (video.style.zIndex = strip === this.strips[which] ? "1" : "0"));
  }

  /** Seconds into the film, by the last frame of the film that is shown. */
  get mediaTime() {
    const strip = this.strips[this.shown];
    return this.frameTimes[strip] ?? this.videos[strip].currentTime;
  }

  pause() {
    for (const video of this.videos) video.pause();
  }

  /** Plays the films until that much was shown. @param {number} exposure_s @param {AbortSignal} signal */
  play(exposure_s, signal) {
    this.frameTimes = [];
    this.n_mismatches = 0;
    this.videos.forEach((video, strip) => followFrames(video, signal, (time_s) => (this.frameTimes[strip] = time_s)));
    this.count = new PlaybackCount(this.videos, signal);
    return playFor(this.videos, exposure_s, signal, () => this.#compare());
  }

  /** Counts a refresh of the display at which A and B are different frames, as far as the browser tells. */
  #compare() {
    const [top, bottom] = this.videos.map((video, strip) => Math.round((this.frameTimes[strip] ?? video.currentTime) * this.fps));
    if (bottom !== undefined && top !== bottom) this.n_mismatches += 1; // a film that is shown alone has no other
  }

  /** The exposure's counts, for the viewing record. */
  get quality() {
    return { ...this.count?.quality, n_mismatches: this.n_mismatches };
  }
}

/** @param {HTMLElement} film */
function newVideo(film) {
  const video = document.createElement("video");
  video.className = "twin";
  Object.assign(video, { muted: true, playsInline: true, disablePictureInPicture: true, disableRemotePlayback: true, preload: "auto", tabIndex: -1 });
  video.setAttribute("aria-hidden", "true");
  film.append(video);
  return video;
}
