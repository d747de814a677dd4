/** The session API as the page uses it (`/api/v1`); an HttpOnly cookie says which session asks. */

import { Unreachable, request } from "./connection.js";

/**
 * @typedef {"a" | "b"} Letter
 * @typedef {Letter | "reference"} Shown
 * @typedef {"introduction" | "screening" | "practice" | "trial" | "interview" | "finished" | "withdrawn" | "screened_out" | "timed_out"} Stage
 * @typedef {object} Session
 * @property {string} session its id
 * @property {{slug: string, title: string, exposure_s: number}} study
 * @property {Stage} stage
 * @property {Stage[]} stages of this study, in order
 * @property {{done: number, total: number}} progress
 * @property {Partial<Record<Stage, number>>} minutes about how long each stage takes
 * @property {boolean} was_away_long since the last answer
 * @property {string} resume_code
 * @property {boolean} stopped whether a film has failed as often as it may be tried
 * @property {Ending | null} ending null before the end, or where the study says nothing of it
 * @property {string | null} language of all its texts; null: it was begun by another client than the page
 * @property {string | null} debriefing_html made by the server from the study's Markdown; null before the end
 *
 * @typedef {object} Ending where a participant of a recruiting platform goes at the end
 * @property {string | null} code completion code
 * @property {string | null} url
 * @property {number} after_s seconds after which the page goes there by itself; 0: never
 *
 * @typedef {object} Media one film that holds both stimuli, one above the other, or a single one
 * @property {string} url
 * @property {{url: string, type: string} | null} second the same film, for browsers that do not play the first
 * @property {string | null} lighter the same film with fewer bytes, for slow lines; null where the study has none
 * @property {string[] | null} singles each strip alone, from the top, for browsers that play neither; null where the study has none
 * @property {"stacked" | "single"} layout single: one stimulus, called A
 * @property {"top" | "bottom"} a
 * @property {number} width of one half, pixels
 * @property {number} height of one half, pixels
 * @property {number} guard_rows between the halves, pixels
 * @property {boolean} reference whether it lies below both, after as many guard rows
 * @property {number} fps
 * @property {number} n_frames
 * @property {"fit" | "1:1"} pixels how large it is shown
 *
 * @typedef {object} TrialDescription
 * @property {string} trial
 * @property {number} attempt from 2 when it is repeated because it was interrupted
 * @property {number} number one more than there are votes
 * @property {number} place its own number, which it keeps when it comes again
 * @property {number} total
 * @property {boolean} is_practice
 * @property {number} exposure_s
 * @property {boolean} free_exposure the participant ends it
 * @property {boolean} see_both the vote waits until A and B were both on screen
 * @property {number} minimum_viewing_s the vote waits until A and B were each on screen as long
 * @property {number} longest_gap_ms between two frames; a longer one interrupts a look, too: suspended
 * @property {Reason[]} void_on what interrupts a look
 * @property {"asked" | "required"} full_screen required: nothing is shown without it
 * @property {number[]} minimum_window width and height, CSS pixels; empty: any
 * @property {Letter} first_shown
 * @property {Media} media
 * @property {string | null} [next_media]
 * @property {TrialDescription | null} [following] the next trial, for as long as the connection is gone
 *
 * @typedef {"stacked" | "webcodecs"} Technique how A and B are kept in step
 *
 * @typedef {"full screen" | "hidden" | "blur" | "resize" | "left the page" | "suspended"} Reason why an attempt was interrupted
 * @typedef {"hidden" | "visible" | "full screen left" | "full screen" | "blur" | "focus" | "resize" | "shown again"} Happening what happened to the page
 *
 * @typedef {object} Viewing times in ms of performance.now() since the first shown frame
 * @property {Letter} first_shown
 * @property {Technique} technique
 * @property {boolean} lighter_film whether the film with fewer bytes was shown
 * @property {number} [wait_ms] from when the participant was ready to the fixation
 * @property {number} shown_ms
 * @property {number} response_ms from the voting screen to Next
 * @property {{to: Shown, at_ms: number, media_time_s: number, frame: number, frame_ms?: number, presented_ms?: number}[]} switches press, frame of the film, the animation frame that drew it, and the refresh at which the display had it
 * @property {{a: number, b: number, reference?: number}} [dwell_ms] how long each was on screen and ran
 * @property {number} [n_changes] of the choice, before Next
 * @property {number} [n_frames] decoded
 * @property {number} [n_dropped]
 * @property {number} [n_mismatches] refreshes of the display at which A and B were different frames
 * @property {number} [n_stalls]
 * @property {{longest_gap_ms: number, n_presented: number, n_refreshes: number}} [smoothness] how the film ran on the display
 * @property {{what: Happening, at_ms: number}[]} happened until Next; before the first frame the times are negative
 * @property {Reason} [interruption] of a repetition
 * @property {{window_width: number, window_height: number, device_pixel_ratio: number, full_screen: boolean}} [display]
 *
 * @typedef {object} Vote
 * @property {string} id made by the browser, so that a vote sent twice counts once
 * @property {Letter | "none"} [choice] where pairs are compared
 * @property {number} [rating] in all other protocols
 * @property {Viewing} viewing
 */

/**
 * @typedef {object} Certificate whether this display is fine enough for the acuity test from where the participant sits
 * @property {boolean} can_certify
 * @property {number} distance_cm
 * @property {number} needed_distance_cm
 *
 * @typedef {object} ScreeningState
 * @property {{test: "acuity" | "colour", has_begun: boolean, is_over: boolean, n_answered: number}[]} tests
 * @property {"typed" | "fixed" | "blind spot"} distance how to measure it
 * @property {number | null} pixel_mm of the display's own pixels
 * @property {Certificate | null} certificate
 * @property {number | null} seat_cm from the display to where the films are seen from; null while it is not measured
 *
 * @typedef {object} ScreeningItem a ring or a plate
 * @property {number} number
 * @property {number} total
 * @property {string} picture its address
 * @property {number[]} choices directions
 * @property {boolean} may_be_nothing
 */

const API = "/api/v1";
const LONGEST_REASON = 300; // characters
const LONGEST_ANSWER_MS = 30_000; // then it is taken for lost, and asked for again: some lines break without a word
const LARGEST_KEPT_ALIVE = 32_768; // bytes; browsers refuse more than 64 KiB under way at once

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
