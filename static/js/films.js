/** Keeps films in memory: they are fetched whole before they are shown, so that the network cannot disturb a trial. */

import { Unreachable, patiently, request } from "./connection.js";

/** @typedef {{received: number, size: number, whole: Promise<Blob[]>}} Film bytes received, bytes in all (0: unknown), and its files */

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
    const parts = urls.map((url) => new Part(url));
    const film = {
      get received() {
        return parts.reduce((sum, part) => sum + part.received, 0);
      },
      get size() {
        return parts.some((part) => part.size === 0) ? 0 : parts.reduce((sum, part) => sum + part.size, 0);
      },
      whole: Promise.all(parts.map((part) => patiently(() => part.download()))),
    };
    film.whole.catch(() => this.films.delete(key)); // who shows the film handles the error
    this.films.set(key, film);
    return film;
  }

  /** Forgets all films but these. @param {string[][]} kept */
  keepOnly(kept) {
    const keys = kept.map((urls) => urls.join(" "));
    for (const key of this.films.keys()) if (!keys.includes(key)) this.films.delete(key);
  }
}

/** A file that is being fetched. */
class Part {
  /** @param {string} url */
  constructor(url) {
    this.url = url;
    this.received = 0;
    this.size = 0;
  }

  /** @returns {Promise<Blob>} */
  async download() {
    const response = await request(this.url);
    this.received = 0;
    this.size = Number(response.headers.get("Content-Length") ?? 0);
    const reader = /** @type {ReadableStream<Uint8Array<ArrayBuffer>>} */ (response.body).getReader();
    const pieces = [];
    for (;;) {
      const { done, value } = await reader.read().catch((cause) => {
        throw new Unreachable(`${this.url} broke off`, { cause });
      });
      if (done) break;
      pieces.push(value);
      this.received += value.length;
    }
    if (this.size && this.received !== this.size) {
      throw new Unreachable(`${this.url} has ${this.received} of ${this.size} bytes`);
    }
    return new Blob(pieces, { type: response.headers.get("Content-Type") ?? "video/mp4" });
  }
}
