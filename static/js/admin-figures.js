// Results: a figure becomes one whose numbers can be read off, by Vega with its interpreter, when it comes into view.
// Without the packages, or before, the picture that the server drew stays.

const tips = document.createElement("div");
tips.className = "tip";
tips.hidden = true;
document.body.append(tips);

const seen = new IntersectionObserver((entries) => {
  for (const entry of entries.filter((one) => one.isIntersecting)) {
    seen.unobserve(entry.target);
    draw(/** @type {HTMLElement} */ (entry.target)).catch(() => {}); // the picture stays
  }
});

const watch = () => {
  for (const figure of document.querySelectorAll("figure[data-vega]:not(.is-watched)")) {
    figure.classList.add("is-watched");
    seen.observe(figure);
  }
};
watch();
document.body.addEventListener("htmx:afterSwap", watch);

/** @type {Promise<any> | undefined} */
let packages;

/** @param {HTMLElement} figure */
async function draw(figure) {
  packages ??= load();
  const [{ expressionInterpreter }, answer] = await Promise.all([packages, fetch(figure.dataset.vega)]);
  if (!answer.ok) throw new Error(`${answer.status} from ${answer.url}`); // its words are no figure
  const spec = await answer.json();
  const ground = document.createElement("div");
  const view = new window.vega.View(window.vega.parse(spec, undefined, { ast: true }), {
    expr: expressionInterpreter,
    renderer: "svg",
    hover: true,
    tooltip: (_handler, event, _item, value) => tell(event, value),
  });
  await view.initialize(ground).runAsync();
  figure.querySelector(".plot-ground").replaceChildren(ground);
}

async function load() {
  await new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/static/vendor/vega.min.js";
    script.addEventListener("load", resolve);
    script.addEventListener("error", reject);
    document.head.append(script);
  });
  return import("/static/vendor/vega-interpreter.js");
}

/** @param {MouseEvent} event @param {unknown} value */
function tell(event, value) {
  tips.hidden = value === null || value === undefined || value === "";
  if (tips.hidden) return;
  tips.textContent = typeof value === "object" ? Object.entries(value).map(([name, one]) => `${name}: ${one}`).join("\n") : String(value);
  tips.style.left = `${Math.min(event.pageX + 12, document.documentElement.scrollWidth - 220)}px`;
  tips.style.top = `${event.pageY + 12}px`;
}
