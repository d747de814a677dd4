// Asks before a page is left while a form on it holds changes that were not sent.

/** @type {Set<EventTarget>} */
const changed = new Set();
const refused = document.getElementById("form-error")?.closest("form"); // shown as it was sent, and kept nowhere
if (refused) changed.add(refused);

document.addEventListener("input", ({ target }) => {
  const form = target && "form" in target ? target.form : null;
  if (form instanceof HTMLFormElement && form.method === "post") changed.add(form);
});
document.addEventListener("submit", ({ target }) => target && changed.delete(target));
window.addEventListener("beforeunload", (event) => {
  if (changed.size) event.preventDefault();
});
