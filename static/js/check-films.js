/** Plays every film of a list to its end, as a participant's page would, and tells the server that asked for it. */

import { UNDECODED, attach, checkSize, detach, readiness, whyNotShown } from "./playback.js";
import { readTrack } from "./mp4.js";

/**
 * @typedef {object} ListedFilm
 * @property {string} url
 * @property {"video" | "decoder"} by what shows it
 * @property {string} type with its codec
 * @property {number} width
 * @property {number} height
 * @property {number} n_frames
 * @property {number} fps
 */

const FASTEST = 8; // times the film's own speed; every picture is decoded at any
const SILENCE_MS = 30_000; // without any progress: the film stands still
const END_TOLERANCE_FRAMES = 2; // of the position at the end, which browsers round

const status = /** @type {HTMLElement} */ (document.getElementById("status"));
/** @type {ListedFilm[]} */
const films = await (await fetch("films.json")).json();
for (const [number, film] of films.entries()) {
  status.textContent = `${number + 1} of ${films.length}`;
  const fault = await faultOf(film).catch((error) => String(error?.message ?? error));
  await fetch("told", { method: "POST", body: JSON.stringify({ number, fault }) });
}
status.textContent = "done";

/** @param {ListedFilm} film @returns {Promise<string>} empty: it plays */
async function faultOf(film) {
  if (document.createElement("video").canPlayType(film.type) === "") return `could not be checked, as this browser has no ${film.type}`;
  const response = await fetch(film.url);
  if (!response.ok) return `the file cannot be read (${response.status})`;
  const blob = await response.blob();
  return film.by === "decoder" && "VideoDecoder" in window ? decode(blob, film) : play(blob, film);
}

/** @param {Blob} blob @param {ListedFilm} film */
async function play(blob, film) {
  const video = document.createElement("video");
  const ending = new AbortController();
  video.muted = true;
  document.body.append(video);
  try {
    attach(video, new Blob([blob], { type: "video/mp4" }));
    await within(readiness(video, ending.signal), "the film does not begin");
    checkSize(video, film.width, film.height);
    video.playbackRate = FASTEST;
    await playedToEnd(video);
    const missing = film.n_frames / film.fps - video.currentTime;
    if (missing > END_TOLERANCE_FRAMES / film.fps) return `it ends ${missing.toFixed(2)} s early`;
    const n = video.getVideoPlaybackQuality().totalVideoFrames; // those left out at this speed, too
    return n < film.n_frames - END_TOLERANCE_FRAMES ? `${n} pictures were decoded, expected ${film.n_frames}` : "";
  } finally {
    ending.abort();
    detach(video);
    video.remove();
  }
}

/** @param {HTMLVideoElement} video @returns {Promise<void>} */
function playedToEnd(video) {
  return new Promise((resolve, reject) => {
    let heard = performance.now();
    const timer = setInterval(() => {
      if (performance.now() - heard > SILENCE_MS) finish(() => reject(new Error("the film stands still")));
    }, 500);
    const finish = (/** @type {() => void} */ how) => {
      clearInterval(timer);
      how();
    };
    video.ontimeupdate = () => (heard = performance.now());
    video.onended = () => finish(resolve);
    video.onerror = () => finish(() => reject(whyNotShown(video)));
    video.play().catch((error) => finish(() => reject(error)));
  });
}

/** Decodes every picture, as browsers do that show films one by one. @param {Blob} blob @param {ListedFilm} film */
async function decode(blob, film) {
  const { codec, description, width, height, pictures } = readTrack(await blob.arrayBuffer());
  if (width !== film.width || height !== film.height) return `the film is ${width}x${height}, expected ${film.width}x${film.height}`;
  let n = 0;
  let fault = "";
  const decoder = new VideoDecoder({
    output: (picture) => {
      n += 1;
      picture.close();
    },
    error: (error) => (fault = `${UNDECODED}: ${error.message}`),
  });
  decoder.configure({ codec, description, codedWidth: width, codedHeight: height });
  pictures.forEach(({ data, isKey }, number) => decoder.decode(new EncodedVideoChunk({ type: isKey ? "key" : "delta", timestamp: number, data })));
  await within(decoder.flush(), "the decoder does not end").catch((error) => (fault ||= error.message));
  if (decoder.state !== "closed") decoder.close();
  return fault || (n === film.n_frames ? "" : `${n} pictures were decoded, expected ${film.n_frames}`);
}

/** @template T @param {Promise<T>} promise @param {string} fault @returns {Promise<T>} */
function within(promise, fault) {
  return Promise.race([promise, new Promise((_, reject) => setTimeout(() => reject(new Error(fault)), SILENCE_MS))]);
}
