/** The questionnaire: what its fields hold, as the answers that the server keeps. */

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
