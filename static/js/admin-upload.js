// Sends a file of stimuli or of results, then opens the page that shows how its check goes.

import { reasonIn } from "./admin-refusal.js";
import { byId, required } from "./elements.js";

/** @param {HTMLFormElement} form @param {Blob} file */
export function sendFile(form, file) {
  const state = byId("upload-state");
  const bar = required(HTMLProgressElement, "progress", state);
  const words = required(HTMLElement, "span", state);
  const button = form.querySelector("button");
  const request = new XMLHttpRequest(); // fetch reports no progress of an upload
  state.hidden = false;
  words.textContent = "";
  if (button) button.disabled = true;
  const fail = (/** @type {string} */ reason) => {
    bar.value = 0;
    words.textContent = reason;
    if (button) button.disabled = false;
  };
  request.upload.addEventListener("progress", (sent) => (bar.value = sent.loaded / sent.total));
  request.addEventListener("load", () => {
    if (request.status === 202) window.location.assign(JSON.parse(request.responseText).task);
    else fail(reasonIn(request.responseText, request.status));
  });
  request.addEventListener("error", () => fail("The connection was lost. Please try again."));
  request.open("PUT", `${form.dataset.to ?? ""}${queryOf(form)}`);
  request.setRequestHeader("X-CSRF-Token", form.dataset.formToken ?? "");
  request.setRequestHeader("Content-Type", "application/octet-stream");
  request.send(file);
}

/** What fields of a form say beside the file. @param {HTMLFormElement} form */
function queryOf(form) {
  const query = new URLSearchParams();
  for (const field of /** @type {NodeListOf<HTMLInputElement>} */ (form.querySelectorAll("[data-query]"))) {
    if (field.type === "checkbox" ? field.checked : field.value.trim()) query.set(field.name, field.value.trim());
  }
  return query.size ? `?${query}` : "";
}

const form = document.getElementById("upload-form"); // absent for those who may not upload
if (form instanceof HTMLFormElement) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const file = new FormData(form).get("file");
    if (file instanceof File) sendFile(form, file);
  });
}
