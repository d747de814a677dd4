/** The participant's page, from Begin to the thanks. The server knows the stage; the page shows it. */

import { Refusal, onTrouble, patiently } from "./connection.js";
import { Films } from "./films.js";
import { readAnswers } from "./interview.js";
import { Outbox, openShelf, randomId } from "./outbox.js";
import { checkBrowser } from "./browser-check.js";
import { display } from "./display.js";
import { inBrowser, inTab } from "./remembered.js";
import { takeScreening } from "./screening.js";
import { beginSession, completeStage, markComprehension, readNextTrial, readPractice, readSession, tellTrouble, tellTurnedAway, withdraw } from "./session.js";
import { claim, takeOver } from "./tabs.js";
import { bestTechnique, filmsOf } from "./technique.js";
import { SWITCH_KEYS, Trial, enterFullScreen, fill } from "./trial.js";

/**
 * @typedef {import("./session.js").Session} Session
 * @typedef {import("./session.js").TrialDescription} TrialDescription
 */

const N_INSTRUCTIONS = 3;
const VOTING_S = 5; // about what a vote takes, for the length that is announced
const SYNC_PATIENCE_MS = 1500; // before the study goes on without the server, with what is already here
const FEWEST_AFTER_BREAK = 5;
const MESSAGE_AT_THE_DOOR = new Map([[404, "unknown"], [410, "used"], [409, "used"], [403, "closed"]]);

const page = /** @type {HTMLElement} */ (document.getElementById("study"));
const breakEvery = Number(page.dataset.breakEvery); // trials; 0: never
const code = page.dataset.code ?? "";
const beginKey = `begin ${code}`;
const shelf = await openShelf();
const films = new Films();
const technique = await bestTechnique(byId("browser-check").dataset);
/** @type {Outbox} */
let outbox; // of the session, once there is one
/** The trial after the present one, in case the server cannot be reached. @type {TrialDescription | null} */
let ahead = null;
let lastBreak = 0; // answers before it
/** @type {object[]} rounds of practice */
const practised = [];
/** @type {Trial | null} */
let trial = null; // that runs now
let wrongAnswers = 0;
let pageKey = ""; // of the session: which page of the instructions is open
let consentKey = ""; // of the session: the digest of the text that was agreed to

/** What is shown in each stage of a session. @type {Record<import("./session.js").Stage, () => void>} */
const STAGES = {
  introduction: introduce,
  screening: () => guarded(screen),
  practice: () => show("practice"),
  trial: () => guarded(runTrials),
  interview: () => show("interview"),
  finished: thank,
  withdrawn: () => show("withdrawn"),
  screened_out: () => {
    leaveFullScreen();
    show("screened-out");
  },
};

onTrouble((isInTrouble) => byId("notice").firstElementChild?.toggleAttribute("hidden", !isInTrouble));
document.addEventListener("keydown", pressPrimary);
document.addEventListener("keydown", switchTryByKey);
byId("begin").addEventListener("click", begin);
checkBrowser(byId("browser-check"), technique);
byId("no-codec").hidden = technique !== null;
byId("begin").hidden = technique === null;
if (technique === null) tellTurnedAway(page.dataset.slug ?? "", code).catch(() => {}); // it is for the log only
for (const id of ["continue", "after-interruption", "after-break"]) byId(id).addEventListener("click", goOnWithTrials);
for (const button of page.querySelectorAll("[data-reload]")) button.addEventListener("click", () => location.reload());
document.getElementById("another")?.addEventListener("click", welcome); // where an invitation is for several
byId("try").addEventListener("click", switchTry);
for (const button of page.querySelectorAll("[data-step]")) button.addEventListener("click", turnInstructions);
document.getElementById("consent")?.addEventListener("submit", consent);
document.getElementById("comprehension")?.addEventListener("submit", checkComprehension);
for (const id of ["practise", "practise-again"]) document.getElementById(id)?.addEventListener("click", goOnWithPractice);
document.getElementById("end-practice")?.addEventListener("click", endPractice);
document.getElementById("questionnaire")?.addEventListener("submit", sendInterview);
document.getElementById("questionnaire")?.addEventListener("keydown", stayOnEnter);
for (const button of page.querySelectorAll("[data-withdraw]")) button.addEventListener("click", () => dialog().showModal());
byId("withdraw-yes").addEventListener("click", leaveForGood);

if (page.dataset.state === "mine") guarded(resume);
else welcome();

function welcome() {
  byId("begin").toggleAttribute("disabled", false);
  show("welcome");
}

/** The one press that uses the invitation up; should its answer be lost, the key leads to the same session again. */
function begin() {
  enterFullScreen();
  byId("begin").toggleAttribute("disabled", true);
  const key = inBrowser.get(beginKey) ?? randomId();
  inBrowser.set(beginKey, key);
  guarded(async () => {
    const session = await patiently(() => beginSession(page.dataset.slug ?? "", code, key));
    practised.length = 0;
    await enterSession(session);
    goTo(session);
  });
}

/** Goes on where this browser left. */
async function resume() {
  const found = await patiently(readSession);
  await enterSession(found);
  if (found.stage !== "withdrawn") await outbox.emptied();
  const session = await patiently(readSession); // with the votes that were still here
  tellSession(session);
  lastBreak = session.progress.done;
  if (session.stage !== "trial") goTo(session);
  else if (session.was_away_long) showInstructions(1);
  else show("resume");
}

/** @param {Session} session */
function goTo(session) {
  tellSession(session);
  STAGES[session.stage]();
}

function introduce() {
  const number = Number(inTab.get(pageKey) ?? 0);
  if (!hasAgreed()) show("consent");
  else showInstructions(Math.max(1, number));
}

/** @param {Event} event */
function consent(event) {
  event.preventDefault();
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  if (!form.reportValidity()) return;
  inTab.set(consentKey, form.dataset.sha256 ?? "");
  showInstructions(1);
}

/** Whether this session's participant has agreed, here, to the text as it stands now; or none is asked for. */
function hasAgreed() {
  const form = document.getElementById("consent");
  return !form || inTab.get(consentKey) === form.dataset.sha256;
}

/** @param {number} number */
function showInstructions(number) {
  inTab.set(pageKey, String(number));
  show(`instructions-${number}`);
}

/** @param {Event} event */
function turnInstructions(event) {
  const step = Number(/** @type {HTMLElement} */ (event.currentTarget).dataset.step);
  const number = Number(page.dataset.showing?.split("-")[1]) + step;
  if (number <= N_INSTRUCTIONS) showInstructions(number);
  else if (page.dataset.stage === "trial") goOnWithTrials();
  else if (document.getElementById("comprehension")) show("comprehension");
  else guarded(endIntroduction);
}

/** One question on the instructions, which the server marks; a wrong answer leads back to them. @param {Event} event */
function checkComprehension(event) {
  event.preventDefault();
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  if (!form.reportValidity()) return;
  const answer = String(new FormData(form).get("understood"));
  form.reset();
  enterFullScreen();
  guarded(async () => {
    const { understood } = await patiently(() => markComprehension(answer));
    if (understood) {
      await endIntroduction({ comprehension: answer, wrong_answers: wrongAnswers });
      return;
    }
    wrongAnswers += 1;
    showInstructions(1);
  });
}

/** @param {object} [more] that came of it */
async function endIntroduction(more = {}) {
  enterFullScreen();
  const form = document.getElementById("consent");
  if (!hasAgreed()) {
    show("consent");
    return;
  }
  const given = form && { version: form.dataset.version, sha256: form.dataset.sha256 };
  await completed("introduction", {
    language: document.documentElement.lang,
    technique,
    ...display(),
    ...(given && { consent: given }),
    ...more,
  });
}

/** @param {string} stage @param {object} data what came of it */
async function completed(stage, data) {
  goTo(await patiently(() => completeStage(stage, data)));
}

async function screen() {
  await takeScreening({ show, tell, showing: () => page.dataset.showing });
  await completed("screening", {});
}

/** @param {Event} event */
function sendInterview(event) {
  event.preventDefault();
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  if (form.reportValidity()) guarded(() => completed("interview", { answers: readAnswers(form) }));
}

/** Practice: each pair again until it was switched; what is chosen is not judged. */
async function practise() {
  const pairs = await patiently(readPractice);
  while (practised.length < pairs.length) {
    const description = pairs[practised.length];
    show("trial");
    const { vote } = await shown(description, performance.now());
    if (!vote) throw new Error("practice is not interrupted");
    if (vote.viewing.switches.length === 0) {
      show("practice-again");
      return;
    }
    const { choice, viewing } = vote;
    const { shown_ms, response_ms, switches } = viewing;
    practised.push({ trial: description.trial, choice, shown_ms, response_ms, n_switches: switches.length });
  }
  show("practice-done");
}

function goOnWithPractice() {
  enterFullScreen();
  guarded(practise);
}

function endPractice() {
  enterFullScreen();
  guarded(() => completed("practice", { rounds: practised }));
}

/** Enter in a field does not end the interview. @param {KeyboardEvent} event */
function stayOnEnter(event) {
  if (event.key === "Enter" && event.target instanceof HTMLInputElement) event.preventDefault();
}

function goOnWithTrials() {
  enterFullScreen();
  guarded(runTrials);
}

/** A trial is asked for when the server has every vote before it; while it cannot be reached, the next one is already here. */
async function runTrials() {
  show("trial");
  for (;;) {
    const askedAt = performance.now();
    const description = await nextTrial();
    if (!description) break;
    if (isTimeForBreak(description)) {
      show("break");
      return;
    }
    ahead = description.following ?? null;
    if (!(await runTrial(description, askedAt))) {
      show("interrupted");
      return;
    }
  }
  goTo(await patiently(readSession));
}

/** @returns {Promise<TrialDescription | null>} */
function nextTrial() {
  const fresh = upToDate();
  fresh.catch(() => {}); // it may fail after the study went on without it; then the next call tells
  return ahead ? Promise.race([fresh, withoutServer(ahead)]) : fresh;
}

/** @returns {Promise<TrialDescription | null>} */
async function upToDate() {
  await outbox.emptied();
  return patiently(readNextTrial);
}

/** @param {TrialDescription} following @returns {Promise<TrialDescription>} once its film is here and the server has had its time */
async function withoutServer(following) {
  await Promise.all([filmOf(following).whole, new Promise((resolve) => setTimeout(resolve, SYNC_PATIENCE_MS))]);
  return following;
}

/** @param {TrialDescription} description @param {number} askedAt @returns {Promise<boolean>} false when it was interrupted */
async function runTrial(description, askedAt) {
  const { following } = description;
  films.keepOnly([description, following].flatMap((one) => (one ? [addresses(one)] : [])));
  if (following) filmOf(description).whole.then(() => filmOf(following)).catch(() => {});
  const { vote, interruption } = await shown(description, askedAt);
  if (vote) await outbox.putVote(description.trial, vote);
  if (interruption) await outbox.putInterruption(description.trial, interruption);
  return !interruption;
}

/** @param {TrialDescription} description @param {number} askedAt performance.now() when the participant was ready for it */
async function shown(description, askedAt) {
  trial = new Trial(byId("trial"), description, filmOf(description), canShow());
  try {
    return await trial.run(askedAt);
  } catch (error) {
    tellTrouble(description.trial, String(error)).catch(() => {}); // it is for the log only
    throw error;
  } finally {
    trial = null;
  }
}

/** @param {TrialDescription} description @returns {import("./films.js").Film} under way or here */
function filmOf(description) {
  return films.get(addresses(description));
}

/** @param {TrialDescription} description of a trial @returns {string[]} of its films */
function addresses({ media }) {
  return filmsOf(canShow(), media);
}

/** @returns {import("./session.js").Technique} */
function canShow() {
  if (!technique) throw new Error("this browser cannot show the films");
  return technique;
}

/** @param {TrialDescription} description of the trial that comes */
function isTimeForBreak({ number, total }) {
  const answered = number - 1;
  if (!breakEvery || answered % breakEvery || answered === lastBreak || total - answered < FEWEST_AFTER_BREAK) return false;
  lastBreak = answered;
  tell({ done: answered, total });
  return answered > 0;
}

function thank() {
  leaveFullScreen();
  show("thanks");
}

/** Withdraws from the study; what is still on its way is not sent any more. */
function leaveForGood() {
  dialog().close();
  trial?.abandon();
  leaveFullScreen();
  guarded(async () => {
    await patiently(withdraw);
    await outbox.clear();
    show("withdrawn");
  });
}

function leaveFullScreen() {
  if (document.fullscreenElement) document.exitFullscreen().catch(() => {});
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
  if (isAtTheDoor) inBrowser.forget(beginKey);
  const message = isAtTheDoor && error instanceof Refusal ? messages[MESSAGE_AT_THE_DOOR.get(error.status) ?? ""] : undefined;
  if (!isAtTheDoor && error instanceof Refusal && error.status === 410) {
    show("withdrawn");
    return;
  }
  const view = viewOf("problem");
  view.children[0].textContent = message?.heading ?? problem.heading;
  view.children[1].textContent = message?.body ?? sentence(error, problem);
  show("problem");
}

/** @param {unknown} error @param {Record<string, string>} problem */
function sentence(error, problem) {
  if (!(error instanceof Refusal)) return problem.media;
  return error.status === 401 ? problem.elsewhere : problem.refused;
}

/** @param {Session} session */
async function enterSession(session) {
  inBrowser.forget(beginKey); // its answer has come; the next participant at this browser makes a new one
  outbox = new Outbox(shelf, session.session);
  pageKey = `instructions of ${session.session}`;
  consentKey = `consent of ${session.session}`;
  tellSession(session);
  if (await claim(session.session, yieldToOther)) return;
  show("elsewhere");
  await new Promise((resolve) => byId("here").addEventListener("click", resolve, { once: true }));
  await takeOver(session.session, yieldToOther);
}

/** The session goes on in another tab: nothing more is done here. */
function yieldToOther() {
  trial?.abandon();
  leaveFullScreen();
  show("yielded");
}

/** @param {Session} session */
function tellSession({ study, stage, progress, resume_code }) {
  page.dataset.stage = stage;
  const minutes = Math.ceil((progress.total * (study.exposure_s + VOTING_S)) / 60);
  tell({ ...progress, seconds: Math.round(study.exposure_s), minutes, resume_code });
}

/** @type {Record<string, unknown>} */
let told = {};

/** @param {Record<string, unknown>} values for the places in the texts */
function tell(values) {
  told = { ...told, ...values };
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll("[data-fill]"))) {
    place.textContent = fill(place.dataset.fill, told);
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
  const hasOwnEnter = event.target instanceof HTMLButtonElement || event.target instanceof HTMLTextAreaElement;
  if (event.key !== "Enter" || event.repeat || hasOwnEnter || dialog().open) return;
  const button = /** @type {HTMLElement | null} */ (viewOf(page.dataset.showing ?? "")?.querySelector("[data-primary]"));
  if (!button || button.hidden) return;
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

function dialog() {
  return /** @type {HTMLDialogElement} */ (byId("withdraw"));
}

/** @param {string} name @returns {HTMLElement} */
function viewOf(name) {
  return /** @type {HTMLElement} */ (page.querySelector(`[data-view="${name}"]`));
}

/** @param {string} id @returns {HTMLElement} */
function byId(id) {
  return /** @type {HTMLElement} */ (document.getElementById(id));
}
