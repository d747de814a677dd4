// Fills the form of a page as it was sent when it was refused, and shows which field is wrong.

const KEPT = ["hidden", "submit", "button", "reset", "file", "password"]; // types of inputs that keep the page's value
const AS_SEEN = ["revision", "seen", "was"]; // what a form says that its page showed

const refused = document.getElementById("refused");
if (refused) showAgain(refused);

/** @param {HTMLElement} message */
function showAgain(message) {
  /** @type {[string, string][]} */
  const typed = JSON.parse(message.dataset.typed ?? "[]");
  const forms = [...document.forms].filter((form) => form.getAttribute("action")?.split("#")[0] === message.dataset.action);
  const same = forms.find((form) => isOf(form, typed));
  const form = same ?? forms.find((form) => isOf(form, typed, AS_SEEN));
  if (typed.length) history.replaceState(null, "", document.referrer); // at the form's address there is no page to load
  if (!form) return; // what was sent stays there, to be copied
  document.getElementById("typed")?.remove();
  form.dataset.refused = "";
  if (typed.length) fill(form, typed, !same);
  const field = message.dataset.field;
  if (field) point(message, form, field);
}

/**
 * Hidden fields tell forms of one address apart.
 * @param {HTMLFormElement} form
 * @param {[string, string][]} typed
 * @param {string[]} besides names of fields that may differ
 */
function isOf(form, typed, besides = []) {
  const hidden = /** @type {NodeListOf<HTMLInputElement>} */ (form.querySelectorAll("input[type=hidden]:not([name=form_token])"));
  return !typed.length || [...hidden].every((input) => besides.includes(input.name) || typed.some(([name, value]) => name === input.name && value === input.value));
}

/**
 * @param {HTMLFormElement} form
 * @param {[string, string][]} typed
 * @param {boolean} hasChanged has somebody else saved something meanwhile, which stands in the form? It is shown beside
 */
function fill(form, typed, hasChanged) {
  /** @type {Map<string, string[]>} */
  const left = new Map();
  for (const [name, value] of typed) left.set(name, [...(left.get(name) ?? []), value]);
  /** @type {string | undefined} */
  let seen; // what the page showed of the field that follows
  for (const field of form.elements) {
    if (field instanceof HTMLInputElement && field.type === "hidden" && field.name === "seen") {
      seen = left.get("seen")?.shift();
    } else if (field instanceof HTMLInputElement && ["checkbox", "radio"].includes(field.type)) {
      field.checked = typed.some(([name, value]) => name === field.name && value === field.value);
    } else if (field instanceof HTMLInputElement || field instanceof HTMLSelectElement || field instanceof HTMLTextAreaElement) {
      const value = field.disabled ? undefined : left.get(field.name)?.shift();
      if (value === undefined || KEPT.includes(field.type)) continue;
      if (value === seen) continue; // not typed here: what another has saved meanwhile stays
      const saved = field.value;
      field.value = value;
      if (hasChanged && field.value !== saved) field.after(savedMeanwhile(saved));
    }
  }
}

/** @param {string} text */
function savedMeanwhile(text) {
  const note = document.createElement("span");
  note.className = "of lines";
  note.textContent = `Saved meanwhile: ${text || "nothing"}`;
  return note;
}

/** @param {HTMLElement} message @param {HTMLFormElement} form @param {string} name of the field */
function point(message, form, name) {
  const part = form.querySelector(`[name="${CSS.escape(name)}"]:not([type=hidden]), [name^="${CSS.escape(name)}."]`);
  const wrong = part?.closest(`fieldset[id="setting-${CSS.escape(name)}"]`) ?? part;
  if (!(wrong instanceof HTMLElement)) return;
  nameByLabel(message, part, name);
  wrong.setAttribute("aria-invalid", "true");
  wrong.setAttribute("aria-describedby", message.id);
  const section = wrong.closest("details");
  if (section) section.open = true;
  wrong.id ||= "refused-field";
  const link = document.createElement("a");
  link.href = `#${wrong.id}`;
  link.textContent = "Show it";
  message.append(" ", link);
}

/** The server knows fields by their names only. @param {HTMLElement} message @param {Element | null} part @param {string} name */
function nameByLabel(message, part, name) {
  const label = part instanceof HTMLInputElement && part.labels?.[0]?.firstChild?.textContent?.trim();
  const told = message.firstChild;
  if (label && told) told.textContent = (told.textContent ?? "").replace(`expected: ${name.replaceAll("_", " ")} `, () => `expected: ${label} `);
}
