// Sends a file of stimuli or of results, then opens the page that shows how its check goes.

import { byId, required } from "./elements.js";

/** @param {HTMLFormElement} form */
function sendFile(form) {
  const state = byId("upload-state");
  const bar = required(HTMLProgressElement, "progress", state);
  const words = required(HTMLElement, "span", state);
  const button = required(HTMLButtonElement, "button", form);
  const request = new XMLHttpRequest(); // fetch reports no progress of an upload
  state.hidden = false;
  words.textContent = "";
  button.disabled = true;
  const fail = (/** @type {string} */ reason) => {
    bar.value = 0;
    words.textContent = reason;
    button.disabled = false;
  };
  request.upload.addEventListener("progress", (sent) => (bar.value = sent.loaded / sent.total));
  request.addEventListener("load", () => {
    if (request.status === 202) window.location.assign(JSON.parse(request.responseText).job);
    else fail(reasonOf(request));
  });
  request.addEventListener("error", () => fail("The connection was lost. Please try again."));
  request.open("PUT", form.dataset.to ?? "");
  request.setRequestHeader("X-CSRF-Token", form.dataset.formToken ?? "");
  request.setRequestHeader("Content-Type", "application/octet-stream");
  request.send(new FormData(form).get("file"));
}

/**
 * Why an upload was refused; a proxy before the server answers with a page of its own.
 * @param {XMLHttpRequest} request
 * @returns {string}
 */
function reasonOf(request) {
  try {
    return JSON.parse(request.responseText).detail;
  } catch {
    return `The server refused the file (${request.status}${request.status === 413 ? ", it is too large" : ""}).`;
  }
}

const form = document.getElementById("upload-form"); // absent for those who may not upload
if (form instanceof HTMLFormElement) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    sendFile(form);
  });
}
