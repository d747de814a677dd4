/** The questionnaire's answers, and the draft that keeps them through a reload until the server has them. */

import { inTab } from "./remembered.js";

const DRAFT = "interview";

/** @param {HTMLFormElement} form @returns {Record<string, string | number | null>} null where a question was left out */
export function readAnswers(form) {
  const values = new FormData(form);
  /** @type {Record<string, string | number | null>} */
  const answers = {};
  for (const question of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-question]"))) {
    const { question: name, kind } = question.dataset;
    const value = String(values.get(name ?? "") ?? "").trim();
    const isNumber = kind === "number" || kind === "scale";
    answers[name ?? ""] = value === "" ? null : isNumber ? Number(value) : value;
  }
  return answers;
}

/** Saves what is typed, so that a reload loses nothing. @param {HTMLFormElement} form @param {string} session its id */
export function keepDraft(form, session) {
  inTab.set(DRAFT, JSON.stringify({ session, answers: Object.fromEntries(new FormData(form)) }));
}

/** Fills in what was typed before in this session; forgets the draft of any other session. @param {HTMLFormElement} form @param {string} session */
export function restoreDraft(form, session) {
  const draft = JSON.parse(inTab.get(DRAFT) ?? "{}");
  if (draft.session !== session) forgetDraft();
  else for (const [name, answer] of Object.entries(draft.answers)) fillIn(form.elements.namedItem(name), answer);
}

export function forgetDraft() {
  inTab.forget(DRAFT);
}

/** @param {Element | RadioNodeList | null} field null: the question is not asked any more @param {string} answer */
function fillIn(field, answer) {
  if (field) /** @type {HTMLInputElement | RadioNodeList} */ (field).value = answer;
}
