/** Films in memory: fetched whole before they are shown, so that no network can disturb a trial. */

import { Unreachable, patiently, request } from "./connection.js";

/** @typedef {{received: number, size: number, whole: Promise<Blob>}} Film bytes so far, of so many (0: unknown), and the file */

export class Films {
  constructor() {
    /** @type {Map<string, Film>} */
    this.films = new Map();
  }

  /** @param {string} url @returns {Film} under way or here */
  get(url) {
    const known = this.films.get(url);
    if (known) return known;
    const film = { received: 0, size: 0, whole: Promise.resolve(new Blob()) };
    film.whole = patiently(() => download(url, film));
    film.whole.catch(() => this.films.delete(url)); // whoever shows the film hears of it
    this.films.set(url, film);
    return film;
  }

  /** Forgets all films but these. @param {(string | null)[]} urls */
  keepOnly(urls) {
    for (const url of this.films.keys()) if (!urls.includes(url)) this.films.delete(url);
  }
}

/** @param {string} url @param {Film} film @returns {Promise<Blob>} */
async function download(url, film) {
  const response = await request(url);
  film.received = 0;
  film.size = Number(response.headers.get("Content-Length") ?? 0);
  const reader = /** @type {ReadableStream<Uint8Array<ArrayBuffer>>} */ (response.body).getReader();
  const parts = [];
  for (;;) {
    const { done, value } = await reader.read().catch((cause) => {
      throw new Unreachable(`${url} broke off`, { cause });
    });
    if (done) break;
    parts.push(value);
    film.received += value.length;
  }
  if (film.size && film.received !== film.size) throw new Unreachable(`${url} has ${film.received} of ${film.size} bytes`);
  return new Blob(parts, { type: response.headers.get("Content-Type") ?? "video/mp4" });
}
