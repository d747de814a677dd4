/** The code with which a participant goes on when the cookie is gone: kept in this browser, as the answers that are still to be sent. */

import { byId, required } from "./elements.js";
import { inBrowser } from "./remembered.js";

const ASKED = "[data-view=known] .another"; // is on the page where a second participant may begin here

/** What this browser keeps of a person: the invitation's code, with the id that a platform's link gives. */
export class Begun {
  /** @param {string} person */
  constructor(person) {
    this.code = `code of ${person}`;
    this.begun = `begun here: begin ${person}`;
  }

  /** The code to go on; empty: it was not kept. */
  get resumeCode() {
    return inBrowser.get(this.code) ?? "";
  }

  /** Whether a session of this person was begun in this browser, here or in another tab. */
  get isBegun() {
    return inBrowser.get(this.begun) !== null;
  }

  /** @param {string} resumeCode each one ends the one before it */
  keep(resumeCode) {
    inBrowser.set(this.begun, "yes");
    inBrowser.set(this.code, resumeCode);
  }

  forget() {
    inBrowser.forget(this.begun);
    inBrowser.forget(this.code);
  }
}

/** Whether another participant may begin at this browser: only then one could be made two people of. */
export function mayBeAnother() {
  return document.querySelector(ASKED) !== null;
}

/** Fills in the code where it was kept. @param {string} code */
export function fillInCode(code) {
  const field = required(HTMLInputElement, "#known-code");
  if (!field.value) field.value = code;
}

/** Says that this browser does not tell who it is, as the person began elsewhere or its cookies are gone. */
export function tellUnknown() {
  const why = byId("known-why");
  why.textContent = why.dataset.lost ?? "";
}

/** Says that the session was lost on the way: the page knows it, and the browser does not any more. */
export function tellLost() {
  tellUnknown();
  document.querySelector(ASKED)?.toggleAttribute("hidden", true);
}

/** Says that a code leads nowhere. */
export function refuseCode() {
  const complaint = byId("known-again");
  complaint.textContent = complaint.dataset.again ?? "";
  required(HTMLInputElement, "#known-code").select();
}
