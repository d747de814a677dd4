/** The session that a page goes through: what it sends and shows, and what this browser or tab remembers of it. */

import { OpenLook } from "./open-look.js";
import { Outbox } from "./outbox.js";
import { inBrowser, inTab } from "./remembered.js";

export class OwnSession {
  /** @type {import("./session.js").Ending | null} where its participant goes at the end */
  ending = null;
  /** @type {object[]} rounds of practice, so far */
  practised = [];
  wrongAnswers = 0; // to the question on the instructions

  /** @param {import("./outbox.js").Shelf} shelf @param {string} id */
  constructor(shelf, id) {
    this.id = id;
    this.outbox = new Outbox(shelf, id);
    this.openLook = new OpenLook(id);
  }

  /** The open page of the instructions, in this tab; 0: none yet. */
  get instructions() {
    return Number(inTab.get(`instructions of ${this.id}`) ?? 0);
  }

  set instructions(number) {
    inTab.set(`instructions of ${this.id}`, String(number));
  }

  /** Digest of the consent's text that was agreed to, in this tab; null: none was. */
  get agreedText() {
    return inTab.get(`consent of ${this.id}`);
  }

  set agreedText(sha256) {
    inTab.set(`consent of ${this.id}`, sha256 ?? "");
  }

  /** Whether this browser shows the films for slow lines. */
  get isLighter() {
    return Boolean(inBrowser.get(`films for slow lines of ${this.id}`));
  }

  /** From now on this browser shows the films for slow lines. */
  lighten() {
    inBrowser.set(`films for slow lines of ${this.id}`, "yes");
  }

  /** @param {number} answered trials before the break @returns {number} how long it has lasted while the page was open, s; Infinity: it had not begun */
  rested_s(answered) {
    const [before, passed_s] = (inBrowser.get(`break of ${this.id}`) ?? "").split(" ").map(Number);
    return before === answered ? passed_s : Infinity;
  }

  /** Remembers how long a break has lasted. @param {number} answered trials before it @param {number} passed_s */
  rest(answered, passed_s) {
    inBrowser.set(`break of ${this.id}`, `${answered} ${passed_s}`);
  }
}
