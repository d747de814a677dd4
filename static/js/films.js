/** Keeps films in memory: they are fetched whole before they are shown, so that the network cannot disturb a trial. */

import { Unreachable, patiently, request } from "./connection.js";

const FEWEST_BYTES = 20_000; // of a film before its speed says anything
const SURE_AFTER_MS = 3000; // of fetching a film; a line is slower in the beginning
const LONGEST_SILENCE_MS = 30_000; // then the line is taken for broken, and the film asked for again

export class Films {
  constructor() {
    /** @type {Map<string, Film>} */
    this.films = new Map();
  }

  /** @param {string[]} urls of all that a trial shows @returns {Film} perhaps still on its way */
  get(urls) {
    const key = urls.join(" ");
    const known = this.films.get(key);
    if (known) return known;
    const film = new Film(urls);
    film.whole.catch(() => this.films.delete(key)); // who shows the film handles the error
    this.films.set(key, film);
    return film;
  }

  /** Forgets the films that are still on their way, and stops fetching them. */
  stop() {
    for (const [key, film] of this.films) {
      if (!Number.isNaN(film.took_ms)) continue;
      film.stop();
      this.films.delete(key);
    }
  }

  /** The film asked for last whose speed is known. @returns {Film | undefined} */
  get latest() {
    return [...this.films.values()].filter((film) => !Number.isNaN(film.mbit_s)).at(-1);
  }

  /** Forgets all films but these. @param {string[][]} kept */
  keepOnly(kept) {
    const keys = kept.map((urls) => urls.join(" "));
    for (const key of this.films.keys()) if (!keys.includes(key)) this.films.delete(key);
  }
}

/** The files of a trial, which are fetched at the same time. */
export class Film {
  /** @param {string[]} urls */
  constructor(urls) {
    this.parts = urls.map((url) => new Part(url));
    this.begunAt = performance.now();
    this.took_ms = NaN; // until it was whole
    this.whole = Promise.all(this.parts.map((part) => patiently(() => part.download()))).then((blobs) => {
      this.took_ms = performance.now() - this.begunAt;
      return blobs;
    });
  }

  /** Is it made of this file? @param {string | null} url */
  holds(url) {
    return this.parts.some((part) => part.url === url);
  }

  /** Fetches no more; `whole` fails. */
  stop() {
    for (const part of this.parts) part.stop();
  }

  /** Bytes so far. */
  get received() {
    return this.parts.reduce((sum, part) => sum + part.received, 0);
  }

  /** Bytes in all; 0: unknown. */
  get size() {
    return this.parts.some((part) => part.size === 0) ? 0 : this.parts.reduce((sum, part) => sum + part.size, 0);
  }

  /** Has it been fetched for so long that the line's speed can be relied on? */
  get isSpeedSure() {
    return !Number.isNaN(this.took_ms) || performance.now() - this.begunAt > SURE_AFTER_MS;
  }

  /** The line's speed so far, megabits a second; NaN: not known yet. */
  get mbit_s() {
    const took_ms = Number.isNaN(this.took_ms) ? performance.now() - this.begunAt : this.took_ms;
    return this.received < FEWEST_BYTES ? NaN : (8 * this.received) / 1000 / took_ms;
  }

  /** Seconds for the whole film at this speed; NaN: not known yet. */
  get seconds() {
    return this.size ? (8 * this.size) / 1e6 / this.mbit_s : NaN;
  }

  /** Seconds until it is here; NaN: not known yet. */
  get secondsLeft() {
    return this.size ? this.seconds * (1 - this.received / this.size) : NaN;
  }
}

/** A file that is being fetched. */
class Part {
  /** @param {string} url */
  constructor(url) {
    this.url = url;
    this.received = 0;
    this.size = 0;
    this.line = new AbortController();
    this.isStopped = false;
  }

  stop() {
    this.isStopped = true;
    this.line.abort();
  }

  /** @returns {Promise<Blob>} */
  async download() {
    if (!this.isStopped) this.line = new AbortController();
    const hush = () => this.line.abort(new DOMException(`${this.url} fell silent`, "TimeoutError"));
    let silence = 0;
    const heard = () => {
      clearTimeout(silence);
      silence = setTimeout(hush, LONGEST_SILENCE_MS);
    };
    heard();
    return this.receive(heard).finally(() => clearTimeout(silence));
  }

  /** @param {() => void} heard is told of every piece @returns {Promise<Blob>} */
  async receive(heard) {
    const { signal } = this.line;
    const response = await request(this.url, { signal });
    this.received = 0;
    this.size = Number(response.headers.get("Content-Length") ?? 0);
    const reader = /** @type {ReadableStream<Uint8Array<ArrayBuffer>>} */ (response.body).getReader();
    const pieces = [];
    for (;;) {
      const { done, value } = await reader.read().catch((cause) => {
        if (this.isStopped) throw cause;
        throw new Unreachable(`${this.url} broke off`, { cause });
      });
      if (done) break;
      heard();
      pieces.push(value);
      this.received += value.length;
    }
    if (this.size && this.received !== this.size) {
      throw new Unreachable(`${this.url} has ${this.received} of ${this.size} bytes`);
    }
    return new Blob(pieces, { type: response.headers.get("Content-Type") ?? "video/mp4" });
  }
}
