// Keeps a job's page up to date: its log shows the last line, and the page is loaded again when the job ends.

const OPEN = ["queued", "running", "stopping"];

function showEndOfLog() {
  const log = document.querySelector(".log");
  if (log) log.scrollTop = log.scrollHeight;
}

document.addEventListener("htmx:afterSwap", () => {
  showEndOfLog();
  const state = document.querySelector("#work-job .state")?.textContent ?? "";
  if (!OPEN.includes(state)) location.reload(); // for the buttons that fit its end
});
showEndOfLog();
