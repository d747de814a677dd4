// Asks before a page is left while a form on it holds changes that were not sent.

/** @type {Set<EventTarget>} */
const changed = new Set();
// shown as it was sent, and kept nowhere
const again = document.querySelector("form[data-refused]") ?? document.getElementById("form-error")?.closest("form");
if (again) changed.add(again);

document.addEventListener("input", ({ target }) => {
  const form = target && "form" in target ? target.form : null;
  if (form instanceof HTMLFormElement && form.method === "post") changed.add(form);
});
document.addEventListener("submit", ({ target }) => target && changed.delete(target));
window.addEventListener("beforeunload", (event) => {
  if (changed.size) event.preventDefault();
});
