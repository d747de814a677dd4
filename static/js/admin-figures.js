// Results: when a figure comes into view, Vega and its interpreter draw it anew so that its numbers can be read off.
// Before that, and without the packages, the picture that the server drew stays.

import { required } from "./elements.js";

/** @typedef {{vega: typeof import("vega"), interpreter: typeof import("/static/vendor/vega-interpreter.js")}} Packages */

const tip = document.createElement("div");
tip.className = "tip";
tip.hidden = true;
document.body.append(tip);

const seen = new IntersectionObserver((entries) => {
  for (const { target } of entries.filter((entry) => entry.isIntersecting)) {
    seen.unobserve(target);
    draw(/** @type {HTMLElement} */ (target)).catch(() => {}); // the server's picture stays
  }
});

const watch = () => {
  for (const figure of document.querySelectorAll("figure[data-vega]:not(.is-watched)")) {
    figure.classList.add("is-watched");
    seen.observe(figure);
  }
};
watch();

document.body.addEventListener("htmx:afterSwap", () => {
  tip.hidden = true; // of a mark that is no more
  watch();
});

/** @type {Promise<Packages> | undefined} */
let packages;

/** @param {HTMLElement} figure */
async function draw(figure) {
  packages ??= load();
  const [{ vega, interpreter }, answer] = await Promise.all([packages, fetch(figure.dataset.vega ?? "")]);
  if (!answer.ok) throw new Error(`${answer.status} from ${answer.url}`); // an error's body is no figure
  const spec = await answer.json();
  const ground = document.createElement("div");
  const view = new vega.View(vega.parse(spec, undefined, { ast: true }), {
    expr: interpreter.expressionInterpreter,
    renderer: "svg",
    hover: true,
    tooltip: (_handler, event, _item, value) => showTip(event, value),
  });
  await view.initialize(ground).runAsync();
  required(HTMLElement, ".plot-ground", figure).replaceChildren(ground);
}

/** @returns {Promise<Packages>} */
async function load() {
  await new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/static/vendor/vega.min.js";
    script.addEventListener("load", resolve);
    script.addEventListener("error", reject);
    document.head.append(script);
  });
  const { vega } = /** @type {typeof globalThis & Pick<Packages, "vega">} */ (globalThis);
  return { vega, interpreter: await import("/static/vendor/vega-interpreter.js") };
}

/** @param {MouseEvent} event @param {unknown} value */
function showTip(event, value) {
  tip.hidden = value === null || value === undefined || value === "";
  if (tip.hidden) return;
  tip.textContent = typeof value === "object" ? Object.entries(value ?? {}).map(([name, field]) => `${name}: ${field}`).join("\n") : String(value);
  tip.style.left = `${Math.min(event.pageX + 12, document.documentElement.scrollWidth - 220)}px`;
  tip.style.top = `${event.pageY + 12}px`;
}
