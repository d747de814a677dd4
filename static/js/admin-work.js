// Keeps a job's page up to date: it is loaded again when the job ends, and its log is then where it was read.

import { isAtEnd } from "./admin-place.js";

const OPEN = ["queued", "running", "stopping"];

const log = document.querySelector(".log");
if (log) log.scrollTop = history.state?.logTop ?? log.scrollHeight;

document.addEventListener("htmx:afterSwap", () => {
  const state = document.querySelector("#work-job .state")?.textContent ?? "";
  if (OPEN.includes(state)) return;
  const shown = document.querySelector(".log");
  if (shown && !isAtEnd(shown)) history.replaceState({ logTop: shown.scrollTop }, "");
  location.reload(); // for the buttons that fit its end
});
