// The folded settings of a study: a search through all of them; a section opens where something in it is asked for, and
// stays open when the page is loaded again.

import { required } from "./elements.js";

const OPEN = `open sections of ${location.pathname}`;
const box = required(HTMLElement, "[data-search]");
const search = required(HTMLInputElement, "input", box);
const status = required(HTMLElement, "[role=status]", box);
const sections = /** @type {HTMLDetailsElement[]} */ ([...document.querySelectorAll("#sections details")]);
const opened = new Set(JSON.parse(sessionStorage.getItem(OPEN) ?? "[]"));

for (const section of sections) {
  section.open ||= opened.has(section.id);
  section.addEventListener("toggle", () => {
    if (search.value.trim()) return; // opened by the search
    if (section.open) opened.add(section.id);
    else opened.delete(section.id);
    sessionStorage.setItem(OPEN, JSON.stringify([...opened]));
  });
}

box.hidden = false;
search.addEventListener("input", () => {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let n_found = 0;
  for (const section of sections) {
    const title = section.querySelector("h3")?.textContent ?? "";
    let n_here = 0;
    for (const setting of section.querySelectorAll("[id^='setting-']")) {
      const text = `${title} ${setting.textContent} ${setting.id}`.toLowerCase();
      const fits = words.every((word) => text.includes(word));
      setting.toggleAttribute("hidden", !fits);
      n_here += Number(fits);
    }
    section.hidden = n_here === 0;
    section.open = words.length ? n_here > 0 : opened.has(section.id);
    n_found += n_here;
  }
  status.textContent = words.length ? `${n_found} found` : "";
});
search.addEventListener("keydown", (event) => {
  if (event.key === "Enter") event.preventDefault(); // which would send the form
});

const OF_PAIRS = ["PC", "CCR"]; // whose answers are not on a scale: any but the first would be refused
const scale = document.querySelector("select[name=scale]");

/** Leaves only the first scale to be chosen where the protocol makes no use of one. */
function fitScale() {
  const protocol = /** @type {HTMLInputElement | null} */ (document.querySelector("[name=protocol]:checked"));
  if (!(scale instanceof HTMLSelectElement) || scale.disabled || !protocol) return;
  const isOfPairs = OF_PAIRS.includes(protocol.value);
  for (const option of scale.options) option.disabled = isOfPairs && option.index > 0;
  if (isOfPairs) scale.selectedIndex = 0;
}

document.addEventListener("input", fitScale);
fitScale();

/** Opens the section that holds an element. @param {EventTarget | null} target */
function reveal(target) {
  const section = target instanceof Element ? target.closest("details") : null; // itself, or what it lies in
  if (section) section.open = true;
}

const revealNamed = () => reveal(document.getElementById(location.hash.slice(1)));
addEventListener("hashchange", revealNamed);
revealNamed();
document.addEventListener("invalid", ({ target }) => reveal(target), true); // a folded field shows no complaint
