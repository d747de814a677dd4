/** The participant's page, from Begin to the thanks. The server knows the stage; the page shows it. */

import { Refusal, Unreachable, onTrouble, patiently } from "./connection.js";
import { Films } from "./films.js";
import { Outbox, openShelf } from "./outbox.js";
import { beginSession, completeStage, readNextTrial, readSession } from "./session.js";
import { SWITCH_KEYS, Trial, enterFullScreen, fill } from "./trial.js";

/** @typedef {import("./session.js").Session} Session */

const N_INSTRUCTIONS = 3;
const VOTING_S = 5; // about what a vote takes, for the length that is announced
const H264 = 'video/mp4; codecs="avc1.640032"'; // high profile, level 5.0: two stimuli of 1920x1080, one above the other
const MESSAGE_OF_STATUS = new Map([[404, "unknown"], [410, "used"], [409, "used"], [403, "closed"]]);

const page = /** @type {HTMLElement} */ (document.getElementById("study"));
const code = page.dataset.code ?? "";
const pageKey = `instructions of ${code}`;
const shelf = await openShelf();
const films = new Films();
/** @type {Outbox} */
let outbox; // of the session, once there is one

onTrouble((isInTrouble) => byId("notice").firstElementChild?.toggleAttribute("hidden", !isInTrouble));
document.addEventListener("keydown", pressPrimary);
document.addEventListener("keydown", switchTryByKey);
byId("begin").addEventListener("click", begin);
byId("continue").addEventListener("click", () => {
  enterFullScreen();
  guarded(runTrials);
});
byId("again").addEventListener("click", () => location.reload());
document.getElementById("another")?.addEventListener("click", welcome); // where an invitation is for several
byId("try").addEventListener("click", switchTry);
for (const button of page.querySelectorAll("[data-step]")) button.addEventListener("click", turnInstructions);

if (page.dataset.state === "mine") guarded(resume);
else welcome();

function welcome() {
  const canPlay = document.createElement("video").canPlayType(H264) !== "";
  byId("no-codec").hidden = canPlay;
  byId("begin").hidden = !canPlay;
  byId("begin").toggleAttribute("disabled", false);
  show("welcome");
}

/** The one press that uses the invitation up. */
function begin() {
  enterFullScreen();
  byId("begin").toggleAttribute("disabled", true);
  guarded(async () => {
    enterSession(await patiently(() => beginSession(page.dataset.slug ?? "", code)));
    showInstructions(1);
  });
}

/** Goes on where this browser left. */
async function resume() {
  enterSession(await patiently(readSession));
  await outbox.emptied();
  const session = await patiently(readSession); // with the votes that were still here
  tellSession(session);
  if (session.stage === "introduction") showInstructions(Number(sessionStorage.getItem(pageKey) ?? 1));
  else if (session.stage === "trial") show("resume");
  else thank();
}

/** @param {number} number */
function showInstructions(number) {
  sessionStorage.setItem(pageKey, String(number));
  show(`instructions-${number}`);
}

/** @param {Event} event */
function turnInstructions(event) {
  const step = Number(/** @type {HTMLElement} */ (event.currentTarget).dataset.step);
  const number = Number(page.dataset.showing?.split("-")[1]) + step;
  if (number <= N_INSTRUCTIONS) showInstructions(number);
  else guarded(startTrials);
}

async function startTrials() {
  enterFullScreen();
  const display = {
    language: document.documentElement.lang,
    window_width: window.innerWidth,
    window_height: window.innerHeight,
    device_pixel_ratio: window.devicePixelRatio,
  };
  await patiently(() => completeStage("introduction", display));
  await runTrials();
}

/** A trial is asked for when the server has every vote before it, so none is shown twice. */
async function runTrials() {
  show("trial");
  for (;;) {
    await outbox.emptied();
    const description = await patiently(readNextTrial);
    if (!description) break;
    await runTrial(description);
  }
  thank();
}

/** @param {import("./session.js").TrialDescription} description */
async function runTrial(description) {
  const { media, next_media } = description;
  films.keepOnly([media.url, next_media]);
  const film = films.get(media.url);
  if (next_media) film.whole.then(() => films.get(next_media)).catch(() => {});
  const vote = await new Trial(byId("trial"), description, film).run();
  await outbox.put(description.trial, vote);
}

function thank() {
  if (document.fullscreenElement) document.exitFullscreen().catch(() => {});
  show("thanks");
}

/** Runs a part of the way; what stops it is told in one calm sentence. @param {() => Promise<void>} part */
function guarded(part) {
  part().catch((error) => {
    console.error(error);
    explain(error);
  });
}

/** @param {unknown} error */
function explain(error) {
  const messages = JSON.parse(page.dataset.messages ?? "{}");
  const problem = JSON.parse(page.dataset.problem ?? "{}");
  const isAtTheDoor = page.dataset.showing === "welcome";
  const message = isAtTheDoor && error instanceof Refusal ? messages[MESSAGE_OF_STATUS.get(error.status) ?? ""] : undefined;
  const view = viewOf("problem");
  view.children[0].textContent = message?.heading ?? problem.heading;
  view.children[1].textContent = message?.body ?? (error instanceof Refusal ? problem.refused : problem.media);
  show("problem");
}

/** @param {Session} session */
function enterSession(session) {
  outbox = new Outbox(shelf, session.session);
  tellSession(session);
}

/** @param {Session} session */
function tellSession({ study, progress }) {
  const minutes = Math.ceil((progress.total * (study.exposure_s + VOTING_S)) / 60);
  const values = { ...progress, seconds: Math.round(study.exposure_s), minutes };
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-fill]"))) {
    place.textContent = fill(place.dataset.fill, values);
  }
}

/** @param {string} name of the one view that is shown now */
function show(name) {
  for (const view of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-view]"))) {
    view.hidden = view.dataset.view !== name;
  }
  page.dataset.showing = name;
  page.className = name === "trial" ? "dark" : "light";
  window.scrollTo(0, 0);
  /** @type {HTMLElement | null} */ (viewOf(name).querySelector('h1[tabindex="-1"]'))?.focus({ preventScroll: true });
}

/** Enter presses a page's main button, wherever the focus is. @param {KeyboardEvent} event */
function pressPrimary(event) {
  if (event.key !== "Enter" || event.repeat || event.target instanceof HTMLButtonElement) return;
  const button = /** @type {HTMLElement | null} */ (viewOf(page.dataset.showing ?? "")?.querySelector("[data-primary]"));
  if (!button) return;
  event.preventDefault();
  button.click();
}

function switchTry() {
  const { dataset } = byId("try");
  dataset.shown = dataset.shown === "a" ? "b" : "a";
}

/** @param {KeyboardEvent} event */
function switchTryByKey(event) {
  const pressesButton = event.key === " " && event.target instanceof HTMLButtonElement;
  if (page.dataset.showing !== "instructions-2" || !SWITCH_KEYS.has(event.key) || event.repeat || pressesButton) return;
  event.preventDefault();
  switchTry();
}

/** @param {string} name @returns {HTMLElement} */
function viewOf(name) {
  return /** @type {HTMLElement} */ (page.querySelector(`[data-view="${name}"]`));
}

/** @param {string} id @returns {HTMLElement} */
function byId(id) {
  return /** @type {HTMLElement} */ (document.getElementById(id));
}
