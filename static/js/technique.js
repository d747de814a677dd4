/** Chooses, before the study, the best way to show A and B in step that the browser has and the study allows. */

import { DecodedPlayer } from "./decoded-player.js";
import { within } from "./patience.js";
import { StackedPlayer } from "./player.js";

/**
 * @typedef {import("./session.js").Technique} Technique
 * @typedef {StackedPlayer | DecodedPlayer} Player
 */

const H264 = 'video/mp4; codecs="avc1.640032"'; // high profile, level 5.0: two stimuli of 1920x1080, one above the other
const SINGLE_CODEC = "avc1.640028"; // level 4.0: one stimulus

/** @type {Record<Technique, new (film: HTMLElement) => Player>} */
const PLAYERS = { stacked: StackedPlayer, webcodecs: DecodedPlayer };

/**
 * @param {{second?: string, fallback?: string, pairs?: string}} offered second: type of the films besides H.264; fallback: technique that the study allows where neither plays; pairs: "decoded" where there is no film of both
 * @returns {Promise<Technique | null>} null: this browser cannot show the study
 */
export async function bestTechnique({ second, fallback, pairs }) {
  if (pairs !== "decoded" && (plays(H264) || (second && plays(second)))) return "stacked";
  return fallback && (await decodes()) ? "webcodecs" : null;
}

/**
 * What is to be fetched for a trial.
 * @param {Technique} technique @param {import("./session.js").Media} media @param {boolean} isLighter the film with fewer bytes, where there is one
 * @returns {string[]} addresses
 */
export function filmsOf(technique, { url, second, singles, lighter }, isLighter = false) {
  if (technique === "stacked" && second && !plays(H264)) return [second.url];
  if (technique === "stacked") return [isLighter && lighter ? lighter : url];
  if (!singles) throw new Error("the study has no film of each stimulus");
  return singles;
}

/** @param {Technique} technique @param {HTMLElement} film the window @returns {Player} */
export function newPlayer(technique, film) {
  return new PLAYERS[technique](film);
}

/** @param {string} type */
function plays(type) {
  return document.createElement("video").canPlayType(type) !== "";
}

/** Whether the browser decodes picture by picture, which browsers do on https and localhost only. */
async function decodes() {
  if (!("VideoDecoder" in window)) return false;
  const told = await within(VideoDecoder.isConfigSupported({ codec: SINGLE_CODEC })).catch(() => null);
  return told?.supported === true;
}
