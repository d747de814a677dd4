/** Shows A and B from separate films, decoded picture by picture: one is drawn only when all films have decoded theirs of the same number. */

import { fitToPage, stripsOf } from "./film-window.js";
import { readTrack } from "./mp4.js";
import { FIRST_PICTURE_MS, FilmClock, Stillness, UNDECODED } from "./playback.js";

/** @typedef {import("./session.js").Shown} Shown */

const AHEAD = 8; // pictures decoded before they are due
const LONGEST_STEP_MS = 100; // of the film's clock at a refresh: after a hidden tab or a busy moment the film goes on where it was

export class DecodedPlayer {
  /** @param {HTMLElement} film the window */
  constructor(film) {
    this.film = film;
    this.canvas = document.createElement("canvas");
    this.strips = { a: 0, b: 1, reference: 2 };
    /** @type {Shown} */
    this.shown = "a";
    this.loaded = new AbortController();
    /** @type {Lane[]} one for each strip, from the top */
    this.lanes = [];
    this.fps = NaN;
    this.n_pictures = 0; // of one pass
    this.current = 0; // number of the pictures that are shown, over all passes
    this.counts = { n_frames: 0, n_dropped: 0, n_stalls: 0, n_mismatches: 0 };
  }

  /**
   * Resolves when the first picture of every film has been decoded.
   * @param {Blob[]} blobs strip by strip @param {import("./session.js").Media} media @param {Shown} first @param {AbortSignal} signal
   */
  async load(blobs, media, first, signal) {
    this.unload();
    this.strips = stripsOf(media);
    this.fps = media.fps;
    this.n_pictures = media.n_frames;
    const tracks = await Promise.all(blobs.map(async (blob) => readTrack(await blob.arrayBuffer())));
    if (signal.aborted) return;
    for (const track of tracks) checkTrack(track, media);
    this.lanes = tracks.map((track) => new Lane(track));
    Object.assign(this.canvas, { width: media.width, height: media.height });
    this.film.append(this.canvas);
    fitToPage(this.film, media, this.loaded.signal);
    await Promise.all(this.lanes.map((lane) => lane.begin(signal)));
    this.current = 0;
    this.show(first);
  }

  unload() {
    this.loaded.abort();
    this.loaded = new AbortController();
    for (const lane of this.lanes.splice(0)) lane.close();
    this.canvas.remove();
  }

  /** Draws the present picture of another strip at once. @param {Shown} which */
  show(which) {
    this.shown = which;
    const picture = this.lanes[this.strips[which]]?.picture(this.current);
    if (picture) /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d", { alpha: false })).drawImage(picture, 0, 0);
  }

  /** Seconds into the film. */
  get mediaTime() {
    return (this.current % this.n_pictures) / this.fps;
  }

  pause() {} // nothing goes on after the exposure's end

  /**
   * Shows the film for an exposure, over and over if it is shorter.
   * @param {number} exposure_s of film; Infinity: until the signal comes @param {AbortSignal} signal
   * @returns {Promise<void>} when that much was shown; rejects when the film stands still
   */
  play(exposure_s, signal) {
    const clock = new FilmClock(this.n_pictures / this.fps, exposure_s);
    const stillness = new Stillness();
    this.counts = { n_frames: 1, n_dropped: 0, n_stalls: 0, n_mismatches: 0 };
    let last = NaN;
    let isStalled = false;
    return new Promise((resolve, reject) => {
      const tick = (/** @type {number} */ now) => {
        if (signal.aborted) return;
        const broken = this.lanes.find((lane) => lane.error);
        if (broken) return reject(broken.error);
        const position_s = clock.position_s + Math.min(now - last || 0, LONGEST_STEP_MS) / 1000;
        last = now;
        if (position_s >= clock.duration_s && !clock.comesAgain) return resolve();
        clock.advance(position_s % clock.duration_s);
        if (clock.isOver) return resolve();
        const isLate = !this.#advance(this.#numberAt(clock));
        if (isLate && !isStalled) this.counts.n_stalls += 1;
        isStalled = isLate;
        if (stillness.lasts(now, this.current)) return reject(new Error("the film stands still"));
        requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    });
  }

  /** @param {FilmClock} clock @returns {number} of the picture that is due, over all passes */
  #numberAt({ passes, position_s }) {
    return passes * this.n_pictures + Math.min(this.n_pictures - 1, Math.floor(position_s * this.fps + 1e-6));
  }

  /** Goes on to the newest number that is due and decoded in every lane. @param {number} due @returns {boolean} whether what is shown is at most one picture late */
  #advance(due) {
    for (const lane of this.lanes) lane.feed(due + AHEAD);
    let next = due;
    while (next > this.current && !this.lanes.every((lane) => lane.picture(next))) next -= 1;
    if (next > this.current) {
      this.counts.n_dropped += next - this.current - 1;
      this.counts.n_frames += next - this.current;
      this.current = next;
      for (const lane of this.lanes) lane.forgetBefore(next);
      if (new Set(this.lanes.map((lane) => lane.oldest)).size > 1) this.counts.n_mismatches += 1;
      this.show(this.shown);
    }
    return due - this.current <= 1;
  }

  /** Pictures drawn in the exposure. */
  get n_presented() {
    return this.counts.n_frames - this.counts.n_dropped;
  }

  /** The exposure's counts, for the viewing record. */
  get quality() {
    return this.counts;
  }
}

/** One film's decoder and the pictures that it has decoded. A picture's timestamp is its number. */
class Lane {
  /** @param {import("./mp4.js").Track} track */
  constructor(track) {
    this.track = track;
    this.n_fed = 0;
    /** @type {VideoFrame[]} by rising number */
    this.pictures = [];
    /** @type {Error | null} */
    this.error = null;
    this.tell = () => {};
    this.decoder = new VideoDecoder({
      output: (picture) => {
        this.pictures.push(picture);
        this.tell();
      },
      error: (error) => {
        this.error = new Error(`${UNDECODED}: ${error.message}`);
        this.tell();
      },
    });
  }

  /** Resolves when the first picture is there. @param {AbortSignal} signal */
  begin(signal) {
    this.decoder.configure(configuration(this.track));
    return new Promise((resolve, reject) => {
      const patience = setTimeout(() => reject(new Error("the decoder gives out no picture")), FIRST_PICTURE_MS);
      signal.addEventListener("abort", () => clearTimeout(patience), { once: true });
      this.tell = () => {
        clearTimeout(patience);
        if (this.error) reject(this.error);
        else resolve(undefined);
      };
      this.feed(AHEAD);
    });
  }

  /** Lets all pictures before a number be decoded; the film begins again after its last. @param {number} end */
  feed(end) {
    for (; this.n_fed < end && this.decoder.state === "configured"; this.n_fed += 1) {
      const { data, isKey } = this.track.pictures[this.n_fed % this.track.pictures.length];
      this.decoder.decode(new EncodedVideoChunk({ type: isKey ? "key" : "delta", timestamp: this.n_fed, data }));
    }
  }

  /** @param {number} number @returns {VideoFrame | undefined} */
  picture(number) {
    return this.pictures.find((picture) => picture.timestamp === number);
  }

  /** Number of the oldest picture that is kept. */
  get oldest() {
    return this.pictures[0]?.timestamp;
  }

  /** @param {number} number */
  forgetBefore(number) {
    while (this.pictures.length > 0 && this.pictures[0].timestamp < number) this.pictures.shift()?.close();
  }

  close() {
    this.tell = () => {};
    if (this.decoder.state !== "closed") this.decoder.close();
    for (const picture of this.pictures.splice(0)) picture.close();
  }
}

/** @param {import("./mp4.js").Track} track @returns {VideoDecoderConfig} */
function configuration({ codec, description, width, height }) {
  return { codec, description, codedWidth: width, codedHeight: height, optimizeForLatency: true };
}

/** @param {import("./mp4.js").Track} track @param {import("./session.js").Media} media */
function checkTrack({ width, height, pictures }, media) {
  if (width !== media.width || height !== media.height || pictures.length !== media.n_frames) {
    throw new Error(`the film is ${pictures.length} pictures of ${width}x${height}, expected ${media.n_frames} of ${media.width}x${media.height}`);
  }
}
