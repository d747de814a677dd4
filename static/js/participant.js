/** The participant's page, from Begin to the thanks. The server knows the stage; the page shows it. */

import { startBreak } from "./break-clock.js";
import { checkBrowser } from "./browser-check.js";
import { FilmTrouble, Refusal, onTrouble, patiently } from "./connection.js";
import { isAgreed, watchReading } from "./consent-form.js";
import { display } from "./display.js";
import { keepsCookies, obstacleOf } from "./door.js";
import { byId, required } from "./elements.js";
import { endingOnPage, showEnding } from "./ending.js";
import { tellInvalidWhenTried } from "./invalid-fields.js";
import { forgetDraft, keepDraft, readAnswers, restoreDraft } from "./interview.js";
import { Begun, fillInCode, mayBeAnother, refuseCode, tellLost, tellUnknown } from "./known-again.js";
import { openShelf, newId } from "./outbox.js";
import { OwnSession } from "./own-session.js";
import { enterFullScreen, fill, stayOnSubmit } from "./page.js";
import { practise } from "./practice.js";
import { inBrowser } from "./remembered.js";
import { takeScreening } from "./screening.js";
import { beginSession, completeStage, eraseOwnData, markComprehension, readPractice, readSession, resumeSession, stayWith, tellTurnedAway, withdraw } from "./session.js";
import { offerSingleKeys } from "./single-keys.js";
import { claim, takeOver } from "./tabs.js";
import { bestTechnique } from "./technique.js";
import { minutesTogether, roughly } from "./time-left.js";
import { Trials } from "./trials.js";
import { listenForTries } from "./try-switch.js";
import { openDialog, page, pressPrimary, show, showAtTheEnd, tell, viewOf } from "./views.js";
import { offerWithdrawal } from "./withdrawal.js";

/** @typedef {import("./session.js").Session} Session */

const VOTING_S = 5; // of a trial, roughly
const SHORTEST_WAIT_S = 2; // that is announced
const ON_THE_WAY = new Set(["introduction", "screening", "practice", "trial"]);
const NO_SESSION = 401; // statuses of answers
const NO_SUCH_CODE = new Set([404, 422]);
const NOT_IN_THIS_STAGE = 409;
const TEXTS_HAVE_CHANGED = 412;
const MESSAGE_AT_THE_DOOR = new Map([[404, "unknown"], [410, "used"], [409, "used"], [422, "bad_link"]]);

const nInstructions = page.querySelectorAll("[data-view^=instructions-]").length;
const breakEvery = Number(page.dataset.breakEvery); // trials; 0: never
const leastBreak_s = Number(page.dataset.breakS);
const code = page.dataset.code ?? "";
const outside = JSON.parse(page.dataset.outside ?? "{}"); // of a recruiting platform's link
const person = page.dataset.person ?? ""; // another id of a platform is another person
const beginKey = `begin ${person}`;
const GO_ON_KEY = "go on";
const begun = new Begun(person);
const isAnother = new URLSearchParams(location.search).has("another"); // a new participant says so
const isPreview = document.querySelector("aside.preview") !== null; // an experimenter tries the study
const shelf = openShelf(() => (byId("not-stored").hidden = false));
const technique = await bestTechnique(byId("browser-check").dataset);
const trials = new Trials(byId("trial"), technique, breakEvery);
const questionnaire = /** @type {HTMLFormElement | null} */ (document.getElementById("questionnaire"));
/** @type {OwnSession} */
let own; // undefined before it has begun
let agreedText = ""; // digest of the consent's text that was agreed to before the session began
let isUnderWay = false; // see `guarded`
let stopClock = () => {}; // of a break

/** What the page does in each stage of a session. @type {Record<import("./session.js").Stage, () => void | Promise<void>>} */
const STAGES = {
  introduction: introduce,
  screening: screen,
  practice: () => show("practice"),
  trial: runTrials,
  interview: () => show("interview"),
  finished: () => end("thanks"),
  withdrawn: () => end("withdrawn"),
  screened_out: () => end("screened-out"),
  timed_out: () => end("timed-out"),
};

onTrouble((isInTrouble) => byId("notice").firstElementChild?.toggleAttribute("hidden", !isInTrouble));
document.addEventListener("keydown", pressPrimary);
page.addEventListener("submit", stayOnSubmit);
byId("begin").addEventListener("click", begin);
checkBrowser(byId("browser-check"), technique);
const lack = technique === null ? "films" : keepsCookies() ? null : "cookies";
byId("no-codec").hidden = lack !== "films";
byId("no-cookies").hidden = lack !== "cookies";
byId("begin").hidden = lack !== null;
if (lack) tellLack(lack);
for (const id of ["continue", "after-interruption", "after-suspension", "after-slowness", "after-break"]) byId(id).addEventListener("click", goOnWithTrials);
window.addEventListener("pageshow", ({ persisted }) => persisted && location.reload()); // back to a page that was put aside
for (const button of page.querySelectorAll("[data-reload]")) button.addEventListener("click", () => location.reload());
listenForTries();
offerSingleKeys(page);
for (const button of page.querySelectorAll("[data-step]")) button.addEventListener("click", turnInstructions);
tellInvalidWhenTried(page);
const consentForm = document.getElementById("consent");
if (consentForm instanceof HTMLFormElement) watchReading(consentForm);
consentForm?.addEventListener("submit", consent);
document.getElementById("decline")?.addEventListener("click", decline);
document.getElementById("comprehension")?.addEventListener("submit", checkComprehension);
for (const id of ["practise", "practise-again"]) document.getElementById(id)?.addEventListener("click", goOnWithPractice);
document.getElementById("end-practice")?.addEventListener("click", endPractice);
questionnaire?.addEventListener("submit", sendInterview);
questionnaire?.addEventListener("keydown", stayOnEnter);
questionnaire?.addEventListener("input", () => keepDraft(questionnaire, own.id));
document.getElementById("begun")?.addEventListener("click", askForCode);
byId("known").addEventListener("submit", goOnByCode);
offerWithdrawal(leaveForGood, (isErasing) => (isErasing ? eraseOwnData() : withdraw()).catch(() => {}));

const announced = JSON.parse(page.dataset.minutes ?? "{}"); // for the consent, before there is a session
if ("trial" in announced) tellMinutes(announced);
const obstacle = obstacleOf(page.dataset);
if (obstacle) turnAway(obstacle);
else if (page.dataset.state === "mine") guarded(resume);
else if (page.dataset.ended === "true") beginNow(); // who has finished sees the code at once, in any browser
else welcome();

/** @param {import("./door.js").Obstacle} why */
function turnAway(why) {
  required(HTMLElement, `[data-obstacle=${why}]`, page).hidden = false;
  show("turned-away");
  tellLack(why);
}

/** For the server's log only. @param {import("./door.js").Lack} what keeps somebody from the study */
function tellLack(what) {
  tellTurnedAway(page.dataset.slug ?? "", code, what).catch(() => {});
}

function welcome() {
  byId("begin").toggleAttribute("disabled", false);
  if (hasBegun()) askForCode();
  else show("welcome");
}

/** Whether who sits here has begun already, in this tab or another: to begin again would make two people of one. */
function hasBegun() {
  return page.dataset.state === "open" && !isAnother && mayBeAnother() && begun.isBegun;
}

function askForCode() {
  if (!begun.isBegun) tellUnknown();
  fillInCode(begun.resumeCode);
  show("known");
}

/** Goes on with the session that this page has lost; at the door, where there is none yet, the form itself leads there. @param {Event} event */
function goOnByCode(event) {
  if (!own) return;
  event.preventDefault();
  const given = String(new FormData(/** @type {HTMLFormElement} */ (event.currentTarget)).get("resume_code"));
  const key = keyNamed(GO_ON_KEY);
  guarded(async () => {
    try {
      await patiently(() => resumeSession(given, key));
    } catch (error) {
      if (!(error instanceof Refusal) || !NO_SUCH_CODE.has(error.status)) throw error;
      refuseCode();
      return;
    }
    inBrowser.forget(GO_ON_KEY);
    await own.outbox.emptied().catch(() => {}); // the code may be another session's
    location.reload();
  });
}

/**
 * Leads to the consent, or begins the session where the study asks for none: who does not agree takes no place. Who has a
 * session already goes on with it, which asks for the consent where it was not given.
 */
function begin() {
  enterFullScreen();
  if (document.getElementById("consent") && page.dataset.state !== "known") show("consent");
  else beginNow();
}

/** Uses the invitation up; should the answer be lost, the key leads to the same session again. */
function beginNow() {
  if (hasBegun()) {
    location.reload(); // another tab has begun meanwhile, and the server knows how far it is
    return;
  }
  byId("begin").toggleAttribute("disabled", true);
  const key = keyNamed(beginKey);
  guarded(async () => {
    const session = await patiently(() => beginSession(page.dataset.slug ?? "", code, key, outside, textsOfPage()));
    history.replaceState(null, "", location.pathname); // the query may have asked for another participant, who has begun now
    if (session.language && session.language !== document.documentElement.lang) {
      location.reload(); // who comes back reads on in the session's language
      return;
    }
    await enterSession(session);
    if (session.stage === "introduction") await goTo(session);
    else await goOn(session); // who comes back by a recruiting platform's link
  });
}

/** The key with which the server knows a request again whose answer was lost: the same until one has come. @param {string} name */
function keyNamed(name) {
  const key = inBrowser.get(name) ?? newId();
  inBrowser.set(name, key);
  return key;
}

/** The language and the digest of the texts that this page shows. */
function textsOfPage() {
  return { language: document.documentElement.lang, texts_sha256: page.dataset.textsSha256 };
}

/** Goes on with the session that this browser has begun. */
async function resume() {
  const session = await patiently(readSession);
  await enterSession(session);
  await goOn(session);
}

/** Sends what is left in this browser and leads to where the session then is. @param {Session} before */
async function goOn(before) {
  if (before.stage !== "withdrawn") {
    await own.openLook.settle(own.outbox);
    await own.outbox.emptied();
  }
  const session = await patiently(readSession); // counts the votes that were still in this browser
  tellSession(session);
  if (session.stopped) {
    endByFilm();
    return;
  }
  trials.lastBreak = own.rested_s(session.progress.done) < leastBreak_s ? 0 : session.progress.done;
  const isTriedOut = isPreview && session.progress.done === 0;
  if (session.stage !== "trial" || isTriedOut) await goTo(session);
  else if (session.was_away_long) showInstructions(1);
  else show("resume");
}

/** Fetches the films to come while the participant reads. @param {Session} session */
async function fetchFilms({ stage, stages }) {
  const isPractised = stages.includes("practice") && stages.indexOf(stage) <= stages.indexOf("practice");
  const practice = isPractised ? await readPractice() : [];
  await trials.fetchAhead(practice.map(({ media }) => media));
}

/**
 * Takes the films for slow lines where the study has them and others would be waited for; says on the last page of the
 * instructions how long the waits will be. @param {Session} session
 */
function watchLine(session) {
  const notice = byId("slow-line");
  const meanwhile = session.study.exposure_s + VOTING_S; // the next film comes during a trial
  if (trials.shouldLighten(meanwhile + SHORTEST_WAIT_S)) {
    own.lighten();
    trials.lighten();
    fetchFilms(session).catch(() => {}); // they are fetched when they are shown
    return;
  }
  const seconds = Math.ceil(trials.filmSeconds - meanwhile);
  notice.hidden = !(seconds >= SHORTEST_WAIT_S);
  notice.textContent = fill(notice.dataset.slow, { seconds });
}

/** @param {Session} session */
async function goTo(session) {
  tellSession(session);
  await STAGES[session.stage]();
}

function introduce() {
  if (!hasAgreed()) show("consent");
  else showInstructions(Math.max(1, own.instructions));
}

/** @param {Event} event */
function consent(event) {
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  if (!isAgreed(form)) return;
  agreedText = form.dataset.sha256 ?? "";
  if (!own) {
    beginNow();
    return;
  }
  own.agreedText = agreedText;
  showInstructions(1);
}

/** Ends without consent: before the session by a word, and after it has begun by withdrawing. */
function decline() {
  if (own) {
    openDialog("withdraw");
    return;
  }
  end("no-consent");
  showEnding(viewOf("no-consent"), endingOnPage(viewOf("no-consent")));
}

/** Whether the participant has agreed, in this tab, to the present text of the consent, or the study asks for none. */
function hasAgreed() {
  const form = document.getElementById("consent");
  return !form || own.agreedText === form.dataset.sha256;
}

/** @param {number} number */
function showInstructions(number) {
  own.instructions = number;
  show(`instructions-${number}`);
}

/** @param {Event} event */
function turnInstructions(event) {
  const step = Number(/** @type {HTMLElement} */ (event.currentTarget).dataset.step);
  const number = Number(page.dataset.showing?.split("-")[1]) + step;
  if (number <= nInstructions) showInstructions(number);
  else if (page.dataset.stage === "trial") goOnWithTrials();
  else if (document.getElementById("comprehension")) show("comprehension");
  else guarded(endIntroduction);
}

/** Sends the answer to the question on the instructions; a wrong answer leads back to them. @param {Event} event */
function checkComprehension(event) {
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  guarded(async () => {
    if (!form.reportValidity()) return;
    const answer = String(new FormData(form).get("understood"));
    form.reset();
    enterFullScreen();
    const { understood } = await patiently(() => markComprehension(answer));
    if (understood) {
      await endIntroduction({ comprehension: answer, wrong_answers: own.wrongAnswers });
      return;
    }
    own.wrongAnswers += 1;
    showInstructions(1);
  });
}

/** @param {object} [more] results of the question on the instructions */
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
    line_mbit_s: trials.line_mbit_s,
    lighter_films: trials.isLighter,
    ...display(),
    ...(given && { consent: given }),
    ...more,
  });
}

/** @param {string} stage @param {object} data its results */
async function completed(stage, data) {
  await goTo(await patiently(() => completeStage(stage, data)));
}

async function screen() {
  await takeScreening({ show, tell, showing: () => page.dataset.showing });
  await completed("screening", {});
}

/** @param {Event} event */
function sendInterview(event) {
  const form = /** @type {HTMLFormElement} */ (event.currentTarget);
  if (!form.reportValidity()) return;
  guarded(async () => {
    await completed("interview", { answers: readAnswers(form) });
    forgetDraft();
  });
}

function goOnWithPractice() {
  enterFullScreen();
  guarded(async () => show(await practise(own, trials)));
}

function endPractice() {
  enterFullScreen();
  guarded(() => completed("practice", { rounds: own.practised }));
}

/** Keeps Enter in a field from ending the interview. @param {KeyboardEvent} event */
function stayOnEnter(event) {
  if (event.key === "Enter" && event.target instanceof HTMLInputElement) event.preventDefault();
}

function goOnWithTrials() {
  enterFullScreen();
  guarded(runTrials);
}

async function runTrials() {
  stopClock();
  show("trial");
  const end = await trials.run(own.outbox, own.openLook);
  if (end === "over") {
    await goTo(await patiently(readSession));
    return;
  }
  show(end);
  if (end === "break") takeBreak(trials.lastBreak);
}

/** Starts a break's clock, or goes on with that of a break during which the page was left. @param {number} answered */
function takeBreak(answered) {
  const before_s = own.rested_s(answered);
  const note = (/** @type {number} */ passed_s) => own.rest(answered, passed_s);
  stopClock = startBreak(viewOf("break"), leastBreak_s, before_s < Infinity ? before_s : 0, note);
}

/** @param {string} view the last one */
function end(view) {
  leaveFullScreen();
  show(view);
  showEnding(viewOf(view), own?.ending ?? null);
}

/** Withdraws from the study, and deletes what was given where that is wanted; what was not sent is dropped. @param {boolean} isErasing */
function leaveForGood(isErasing) {
  trials.abandon();
  leaveFullScreen();
  showAtTheEnd("leaving");
  patiently(withdraw)
    .then((session) => (own.ending = session.ending)) // before what was given is deleted, which knows the way back
    .then(() => (isErasing ? eraseForGood() : null))
    .then(() => own.outbox.clear())
    .then(() => {
      byId("erased").hidden = !isErasing;
      byId("not-erased").hidden = isErasing;
      if (isErasing) begun.forget();
      forgetDraft();
      own.openLook.forget();
      showAtTheEnd("withdrawn");
      showEnding(viewOf("withdrawn"), own.ending);
    })
    .catch((error) => explain(error, showAtTheEnd));
}

/** Has all deleted. When it is asked again because the answer was lost, and the session is gone, then it was deleted. */
async function eraseForGood() {
  let tries = 0;
  await patiently(async () => {
    tries += 1;
    await eraseOwnData().catch((error) => {
      if (tries === 1 || !(error instanceof Refusal) || error.status !== NO_SESSION) throw error;
    });
  });
}

function leaveFullScreen() {
  if (document.fullscreenElement) document.exitFullscreen().catch(() => {});
}

/**
 * Runs a part of the session, and explains on the page what stops it. A part that is asked for while another runs is
 * ignored: a second press before the server's answer does nothing.
 * @param {() => Promise<void>} part
 */
async function guarded(part) {
  if (isUnderWay) return;
  isUnderWay = true;
  try {
    await part();
  } catch (error) {
    if (!(await isTimeOver(error)) && !(await hasStopped(error))) explain(error, show);
  } finally {
    isUnderWay = false;
  }
}

/** Shows the end of a session whose time has run out; the server refuses whatever comes after. @param {unknown} error */
async function isTimeOver(error) {
  if (!own || !(error instanceof Refusal) || error.status !== NOT_IN_THIS_STAGE) return false;
  const session = await readSession().catch(() => null);
  if (session?.stage !== "timed_out") return false;
  await goTo(session);
  return true;
}

/** Ends here where a film failed again: trying it once more would lead in a circle. @param {unknown} error */
async function hasStopped(error) {
  if (!own || !(error instanceof FilmTrouble)) return false;
  console.error(error);
  const session = await readSession().catch(() => null);
  if (!session?.stopped) return false;
  tellSession(session);
  endByFilm();
  return true;
}

/** Says that the study cannot go on, and leads back to the platform. */
function endByFilm() {
  const { heading, refused } = JSON.parse(page.dataset.problem ?? "{}");
  const view = viewOf("problem");
  view.children[0].textContent = heading;
  view.children[1].textContent = refused;
  required(HTMLElement, "[data-reload]", view).hidden = true;
  end("problem");
}

/** @param {unknown} error @param {(view: string) => void} showView */
function explain(error, showView) {
  console.error(error);
  const messages = JSON.parse(page.dataset.messages ?? "{}");
  const problem = JSON.parse(page.dataset.problem ?? "{}");
  const isAtTheDoor = !own;
  if (isAtTheDoor) inBrowser.forget(beginKey);
  if (isAtTheDoor && error instanceof Refusal && error.status === TEXTS_HAVE_CHANGED) {
    location.reload();
    return;
  }
  const message = isAtTheDoor && error instanceof Refusal ? messages[messageFor(error)] : undefined;
  if (!isAtTheDoor && error instanceof Refusal && error.status === 410) {
    showView("withdrawn");
    return;
  }
  if (!isAtTheDoor && error instanceof Refusal && error.status === NO_SESSION) {
    leaveFullScreen();
    tellLost();
    fillInCode(begun.resumeCode);
    showView("known");
    return;
  }
  const view = viewOf("problem");
  view.children[0].textContent = message?.heading ?? problem.heading;
  view.children[1].textContent = message?.body ?? sentence(error, problem);
  showView("problem");
}

/** The key of the message that says why the participant cannot begin. @param {Refusal} refusal @returns {string} */
function messageFor({ status, problem }) {
  return problem.standing ?? MESSAGE_AT_THE_DOOR.get(status) ?? "";
}

/** @param {unknown} error @param {Record<string, string>} problem */
function sentence(error, problem) {
  return error instanceof Refusal ? problem.refused : problem.media;
}

/** @param {Session} session */
async function enterSession(session) {
  inBrowser.forget(beginKey); // the server has answered; the next participant at this browser makes a new key
  stayWith(session.session);
  own = new OwnSession(shelf, session.session);
  if (own.isLighter) trials.lighten();
  if (agreedText) own.agreedText = agreedText;
  if (questionnaire) restoreDraft(questionnaire, session.session);
  tellSession(session);
  if (ON_THE_WAY.has(session.stage)) {
    fetchFilms(session).catch(() => {}); // they are fetched when they are shown
    const timer = window.setInterval(() => {
      if (page.dataset.stage === "introduction") watchLine(session);
      else clearInterval(timer);
    }, 1000);
  }
  if (isOver(session) || (await claim(session.session, yieldToOther))) return;
  show("elsewhere");
  await new Promise((resolve) => byId("here").addEventListener("click", resolve, { once: true }));
  await takeOver(session.session, yieldToOther);
}

/** Whether a session has come to an end of any kind, which any number of tabs may show. @param {Session} session */
function isOver({ stage, stages }) {
  return !stages.includes(stage) || stage === stages[stages.length - 1];
}

/** Stops this page: the session goes on in another tab. */
function yieldToOther() {
  trials.abandon();
  leaveFullScreen();
  showAtTheEnd("yielded");
  document.addEventListener("visibilitychange", thankWhenOver);
  window.addEventListener("focus", thankWhenOver);
}

/** Shows the end on a tab that is left over, once its session has ended in the other one. */
async function thankWhenOver() {
  const session = await readSession().catch(() => null); // somebody else may have begun since
  if (session && isOver(session)) location.reload();
}

/** @param {import("./time-left.js").Minutes} minutes */
function tellMinutes(minutes) {
  tell({ minutes: roughly(minutes.trial), whole_minutes: minutesTogether(minutes), screening_minutes: roughly(minutes.screening) });
  for (const line of /** @type {NodeListOf<HTMLElement>} */ (page.querySelectorAll(".durations [data-stage]"))) {
    const stage = /** @type {import("./session.js").Stage} */ (line.dataset.stage);
    line.textContent = fill(line.dataset.text, { minutes: roughly(minutes[stage]) });
  }
}

/** @param {Session} session */
function tellSession({ study, stage, progress, resume_code, debriefing_html, ...session }) {
  page.dataset.stage = stage;
  own.ending = session.ending;
  trials.minutes = session.minutes;
  tellMinutes(session.minutes);
  begun.keep(resume_code);
  tell({ ...progress, quarter: "", seconds: Math.max(1, Math.round(study.exposure_s)), resume_code });
  byId("debriefing").innerHTML = debriefing_html ?? ""; // the server has rendered it without raw HTML
}
