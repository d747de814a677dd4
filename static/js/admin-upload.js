// A form that takes a zip file, of stimuli or of results: sends it and leads to the page that tells how its check goes.

const form = /** @type {HTMLFormElement | null} */ (document.getElementById("upload-form"));
const state = document.getElementById("upload-state");

form?.addEventListener("submit", (event) => {
  event.preventDefault();
  const file = /** @type {File} */ (new FormData(form).get("file"));
  const request = new XMLHttpRequest(); // fetch tells no progress of what it sends
  const bar = /** @type {HTMLProgressElement} */ (state.querySelector("progress"));
  const words = state.querySelector("span");
  state.hidden = false;
  words.textContent = "";
  form.querySelector("button").disabled = true;
  request.upload.addEventListener("progress", (sent) => (bar.value = sent.loaded / sent.total));
  request.addEventListener("load", () => {
    if (request.status === 202) window.location.assign(JSON.parse(request.responseText).job);
    else fail(reasonOf(request));
  });
  request.addEventListener("error", () => fail("The connection was lost. Please try again."));
  request.open("PUT", form.dataset.to);
  request.setRequestHeader("X-CSRF-Token", form.dataset.formToken);
  request.setRequestHeader("Content-Type", "application/zip");
  request.send(file);

  /** @param {string} reason */
  function fail(reason) {
    bar.value = 0;
    words.textContent = reason;
    form.querySelector("button").disabled = false;
  }
});

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
