// Prints a page whole: what is folded is opened, and pictures that wait to come into view are fetched.

/** @type {HTMLDetailsElement[]} */
let folded = [];

/** Fetch a page's plots one after another: a printer waits for no picture that is asked for when printing begins. */
async function fetchPlots() {
  for (const picture of document.querySelectorAll(".plot img[loading=lazy]")) {
    picture.removeAttribute("loading");
    if (picture instanceof HTMLImageElement) await picture.decode().catch(() => undefined);
  }
}

addEventListener("load", fetchPlots);
document.addEventListener("htmx:load", fetchPlots); // results come, or are shown anew
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("main details:not([open])")].filter((each) => each instanceof HTMLDetailsElement);
  for (const each of folded) each.open = !each.closest(".plot-code");
  for (const picture of document.querySelectorAll("img[loading=lazy]")) picture.removeAttribute("loading");
});
addEventListener("afterprint", () => {
  for (const each of folded) each.open = false;
});
