// Prints a page whole: what is folded is opened, and pictures that wait to come into view are fetched.

/** @type {HTMLDetailsElement[]} */
let folded = [];

// Once the page is there: a printer waits for no picture that is asked for when printing begins.
addEventListener("load", () => {
  for (const picture of document.querySelectorAll(".plot img[loading=lazy]")) picture.removeAttribute("loading");
});
addEventListener("beforeprint", () => {
  folded = [...document.querySelectorAll("main details:not([open])")].filter((each) => each instanceof HTMLDetailsElement);
  for (const each of folded) each.open = !each.closest(".plot-code");
  for (const picture of document.querySelectorAll("img[loading=lazy]")) picture.removeAttribute("loading");
});
addEventListener("afterprint", () => {
  for (const each of folded) each.open = false;
});
