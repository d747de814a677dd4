/** The session API as the page uses it (`/api/v1`); an HttpOnly cookie says which session asks. */

import { LARGEST_KEPT_ALIVE, Unreachable, request } from "./connection.js";

/**
 * The types are made from the server's description of its REST interface: python -m tests.api_types
 * @typedef {import("../../frontend/api").SessionView} Session
 * @typedef {Session["stage"]} Stage
 * @typedef {NonNullable<Session["ending"]>} Ending where a participant of a recruiting platform goes at the end
 * @typedef {import("../../frontend/api").MediaView} Media one film that holds both stimuli, one above the other, or a single one
 * @typedef {import("../../frontend/api").OneTrialView & Partial<import("../../frontend/api").TrialView>} TrialDescription
 * @typedef {import("../../frontend/api").ViewingBody} ViewingBody
 * @typedef {ViewingBody & Required<Pick<ViewingBody, "technique" | "lighter_film" | "happened">>} Viewing with what this page always tells
 * @typedef {Viewing["switches"][number]["to"]} Shown
 * @typedef {Viewing["first_shown"]} Letter
 * @typedef {Exclude<Viewing["technique"], "two videos">} Technique of this page: how A and B are kept in step
 * @typedef {Viewing["happened"][number]["what"]} Happening what happened to the page
 * @typedef {import("../../frontend/api").VoidBody["reason"]} Reason why an attempt was interrupted
 * @typedef {import("../../frontend/api").VoteBody} Vote
 * @typedef {import("../../frontend/api").ScreeningView} ScreeningState
 * @typedef {NonNullable<ScreeningState["certificate"]>} Certificate whether this display is fine enough for the acuity test from where the participant sits
 * @typedef {import("../../frontend/api").ItemView} ScreeningItem a ring or a plate
 */

const API = "/api/v1";
const LONGEST_REASON = 300; // characters
const LONGEST_ANSWER_MS = 30_000; // then it is taken for lost, and asked for again: some lines break without a word

let session = ""; // the id of the session that this page shows; empty before there is one

/** Names the session in every request from now on, in case the cookie comes to hold another. @param {string} id */
export function stayWith(id) {
  session = id;
}

/**
 * @param {string} slug
 * @param {string} invitation
 * @param {string} key the same key leads to the same session
 * @param {Record<string, string>} outside parameters of a recruiting platform's link
 * @param {{language: string, texts_sha256?: string}} texts that the page shows
 * @returns {Promise<Session>}
 */
export function beginSession(slug, invitation, key, outside, texts) {
  return call("POST", `/studies/${encodeURIComponent(slug)}/sessions`, { invitation, key, outside, ...texts });
}

/** Goes on in this browser. @param {string} resume_code @param {string} key the same key leads to the same session @returns {Promise<Session>} */
export function resumeSession(resume_code, key) {
  return call("POST", "/session/resume", { resume_code, key });
}

/** @returns {Promise<Session>} */
export function withdraw() {
  return call("PUT", "/session/withdrawal", {}); // with a body, it survives the page
}

/** Withdraws, and has all that was given deleted for good. @returns {Promise<null>} */
export function eraseOwnData() {
  return call("PUT", "/session/erasure", { confirmed: true });
}

/** @returns {Promise<Session>} */
export function readSession() {
  return call("GET", "/session");
}

/** @param {string} stage @param {object} data @returns {Promise<Session>} */
export function completeStage(stage, data) {
  return call("PUT", `/session/stages/${stage}`, { data });
}

/** @param {string} answer @returns {Promise<{understood: boolean}>} */
export function markComprehension(answer) {
  return call("PUT", "/session/comprehension", { answer });
}

/** @returns {Promise<ScreeningState>} */
export function readScreening() {
  return call("GET", "/session/screening");
}

/** @param {object} card as it was fitted @returns {Promise<ScreeningState>} */
export function sendCard(card) {
  return call("PUT", "/session/screening/display", card);
}

/** @param {object} distance typed or by blind spots @returns {Promise<ScreeningState>} */
export function sendDistance(distance) {
  return call("PUT", "/session/screening/distance", distance);
}

/** @param {string} test @returns {Promise<ScreeningItem | null>} null when the test is over */
export function readItem(test) {
  return call("GET", `/session/screening/${test}`);
}

/** @param {string} test @param {number} number @param {{answer: number | null, response_ms: number}} answer @returns {Promise<ScreeningItem | null>} the next */
export function answerItem(test, number, answer) {
  return call("PUT", `/session/screening/${test}/${number}`, answer);
}

/** @param {string} test @param {string} reason @returns {Promise<null>} */
export function skipTest(test, reason) {
  return call("PUT", `/session/screening/${test}/skip`, { reason });
}

/** @returns {Promise<TrialDescription[]>} what to practise with */
export function readPractice() {
  return call("GET", "/session/practice");
}

/** @returns {Promise<TrialDescription | null>} null when no trial is left */
export function readNextTrial() {
  return call("GET", "/session/trials/next");
}

/** @returns {Promise<Media[]>} of the next trials, to be fetched before they are due */
export function readFilmsAhead() {
  return call("GET", "/session/films");
}

/** @param {string} trial @param {Vote} vote */
export function sendVote(trial, vote) {
  return call("PUT", `/session/trials/${encodeURIComponent(trial)}/vote`, vote);
}

/** @param {string} trial @param {{reason: Reason, viewing: Viewing}} record */
export function sendVoid(trial, record) {
  return call("PUT", `/session/trials/${encodeURIComponent(trial)}/void`, record);
}

/** Reports a film that could not be shown. @param {string} trial @param {string} why */
export function tellTrouble(trial, why) {
  return call("PUT", `/session/trials/${encodeURIComponent(trial)}/trouble`, { why: why.slice(0, LONGEST_REASON) });
}

/** @param {string} url of a ring or a plate @returns {Promise<Blob>} */
export async function readPicture(url) {
  const response = await request(url, { headers: sessionHeader(), signal: AbortSignal.timeout(LONGEST_ANSWER_MS) });
  return response.blob().catch((cause) => {
    throw new Unreachable(`${url} broke off`, { cause });
  });
}

/** Reports a browser that cannot show the study, for the server's log. @param {string} slug @param {string} invitation @param {import("./door.js").Lack} why */
export function tellTurnedAway(slug, invitation, why) {
  return call("POST", `/studies/${encodeURIComponent(slug)}/turned-away`, { invitation, why });
}

/** The header that names this page's session: another tab may have begun another one since. @returns {Record<string, string>} */
function sessionHeader() {
  return session ? { "Session-Id": session } : {};
}

/** @template T @param {string} method @param {string} path @param {object} [body] @returns {Promise<T>} as the API describes it */
async function call(method, path, body) {
  const json = body && new TextEncoder().encode(JSON.stringify(body));
  const response = await request(API + path, {
    method,
    headers: { ...sessionHeader(), ...(json && { "Content-Type": "application/json" }) },
    body: json,
    cache: "no-store",
    signal: AbortSignal.timeout(LONGEST_ANSWER_MS),
    keepalive: json !== undefined && json.length < LARGEST_KEPT_ALIVE, // a vote on its way survives the page
  });
  if (response.status === 204) return /** @type {T} */ (null);
  return response.json().catch((cause) => {
    throw new Unreachable(`half an answer from ${path}`, { cause });
  });
}
