// Sends a file in parts. A part that fails is sent again from where the server is; the same file, chosen again after
// the page was closed, goes on where it stopped.

import { reasonIn } from "./admin-refusal.js";
import { byId, required } from "./elements.js";

/**
 * @typedef {object} Standing how far an upload is, as the server tells it
 * @property {string} upload its address
 * @property {number} offset bytes that are there
 * @property {number} size bytes of the whole file
 * @property {string | null} task address of the task that checks it, once all is there
 */

const PART = 8 * 1024 * 1024; // bytes; a lost connection costs less than this
const FIRST_PAUSE_MS = 1000;
const LONGEST_PAUSE_MS = 30_000;
const NOT_PLAIN = /[^\p{L}\p{N} ._+-]+/gu;

const form = required(HTMLFormElement, "#file-upload");
const fields = {
  kind: required(HTMLSelectElement, "[name=kind]", form),
  file: required(HTMLInputElement, "[name=file]", form),
  name: required(HTMLInputElement, "[name=name]", form),
};
const state = byId("file-upload-state");
const bar = required(HTMLProgressElement, "progress", state);
const words = required(HTMLElement, "span", state);
const send = required(HTMLButtonElement, "[type=submit]", form);
const pause = required(HTMLButtonElement, "#upload-pause", form);

class Refused extends Error {}

/** @type {XMLHttpRequest | null} the part under way */
let underWay = null;
let isPaused = false;

/** Shows what the chosen kind expects, and offers the file's name for the entry. */
function fit() {
  for (const note of form.querySelectorAll("[data-kind]")) {
    if (note instanceof HTMLElement) note.hidden = note.dataset.kind !== fields.kind.value;
  }
  fields.file.accept = { measures: ".csv", clouds: ".ply,.zip" }[fields.kind.value] ?? ".zip";
}

function suggestName() {
  const file = fields.file.files?.[0];
  if (!file) return;
  const isKept = /\.csv$/i.test(file.name) || (/\.ply$/i.test(file.name) && fields.kind.value === "clouds");
  const stem = isKept ? file.name : file.name.replace(/\.[^.]*$/, "");
  fields.name.value = stem
    .normalize("NFC") // accents of some computers stand beside their letters
    .replace(NOT_PLAIN, "-")
    .replace(/^[^\p{L}\p{N}]+|[ .-]+$/gu, "")
    .slice(0, 100);
}

/**
 * Asks the server, and says why it refused.
 * @param {string} method
 * @param {string} address
 * @param {object} [body]
 * @returns {Promise<Standing>}
 */
async function ask(method, address, body) {
  const answer = await fetch(address, {
    method,
    headers: { ...headers(), ...(body ? { "Content-Type": "application/json" } : {}) },
    body: body && JSON.stringify(body),
  });
  if (answer.ok) return answer.json();
  const told = await answer.text();
  if (answer.status >= 500) throw new Error(`${answer.status}`);
  throw new Refused(reasonIn(told, answer.status));
}

function headers() {
  return { Accept: "application/json", "X-CSRF-Token": form.dataset.formToken ?? "" };
}

/**
 * Sends a part of a file; fetch reports no progress of an upload.
 * @param {File} file
 * @param {Standing} standing
 * @returns {Promise<Standing>}
 */
function sendPart(file, standing) {
  const request = new XMLHttpRequest();
  underWay = request;
  return new Promise((resolve, reject) => {
    request.upload.addEventListener("progress", (sent) => tell(standing.offset + sent.loaded, file.size));
    request.addEventListener("load", () => {
      if (request.status < 300) resolve(JSON.parse(request.responseText));
      else if (request.status >= 500 || request.status === 409) reject(new Error(`${request.status}`));
      else reject(new Refused(reasonIn(request.responseText, request.status)));
    });
    for (const end of ["error", "abort", "timeout"]) request.addEventListener(end, () => reject(new Error(end)));
    request.open("PATCH", standing.upload);
    for (const [name, value] of Object.entries(headers())) request.setRequestHeader(name, value);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.setRequestHeader("Upload-Offset", String(standing.offset));
    request.send(file.slice(standing.offset, standing.offset + PART));
  });
}

/** @param {number} sent @param {number} size bytes */
function tell(sent, size) {
  bar.value = sent / size;
  words.textContent = `${Math.floor((100 * sent) / size)} % of ${(size / 1e6).toFixed(1)} MB`;
}

/**
 * Sends what is missing of a file, for as long as it takes; returns the task's address, or null when paused.
 * @param {File} file
 * @param {Standing} standing
 */
async function sendAll(file, standing) {
  let pauseMs = FIRST_PAUSE_MS;
  while (!standing.task) {
    if (isPaused) return null;
    try {
      standing = await sendPart(file, standing);
      pauseMs = FIRST_PAUSE_MS;
    } catch (error) {
      if (error instanceof Refused) throw error;
      if (isPaused) return null;
      words.textContent = "The connection was lost. Trying again…";
      await new Promise((done) => setTimeout(done, pauseMs));
      pauseMs = Math.min(2 * pauseMs, LONGEST_PAUSE_MS);
      standing = await ask("GET", standing.upload).catch((lost) => {
        if (lost instanceof Refused) throw lost;
        return standing;
      });
    }
  }
  return standing.task;
}

async function upload() {
  const file = fields.file.files?.[0];
  if (!file) return;
  isPaused = false;
  send.disabled = true;
  pause.hidden = false;
  state.hidden = false;
  words.textContent = "";
  const wanted = { kind: fields.kind.value, name: fields.name.value, file: file.name, size: file.size };
  try {
    const standing = await ask("POST", "/admin/files/upload", { ...wanted, modified: Math.round(file.lastModified) });
    if (standing.offset) tell(standing.offset, file.size);
    const task = await sendAll(file, standing);
    if (task) window.location.assign(task);
    else words.textContent = `${words.textContent.replace(/\.?$/, ".")} Paused; press Upload to go on.`;
  } catch (error) {
    bar.value = 0;
    words.textContent = error instanceof Refused ? error.message : "The server cannot be reached. Please try again.";
  } finally {
    send.disabled = false;
    pause.hidden = true;
  }
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  upload();
});
pause.addEventListener("click", () => {
  isPaused = true;
  underWay?.abort();
});
fields.kind.addEventListener("change", () => {
  fit();
  suggestName();
});
fields.file.addEventListener("change", suggestName);
fit();
if (!fields.name.value) suggestName(); // the file may have been chosen before this script was there
