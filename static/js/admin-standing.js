// Loads the overview again when its study is opened, paused or closed by a rule or by somebody else, or an alarm begins or
// ends: the page then has other buttons than it was loaded with.

const stated = () => document.querySelector("#monitor [data-standing]")?.getAttribute("data-standing");
const loaded = stated();

document.addEventListener("htmx:afterSwap", () => {
  if (stated() !== loaded) location.reload();
});
