// A page that follows what happens leads to the sign-in when its reader is signed out, and does not just stand still.

document.addEventListener("htmx:responseError", (event) => {
  const { xhr } = /** @type {CustomEvent<{xhr: XMLHttpRequest}>} */ (event).detail;
  leaveIfSignedOut(xhr.status);
});

document.addEventListener("htmx:sseError", (event) => {
  const { source } = /** @type {CustomEvent<{source: EventSource}>} */ (event).detail;
  if (source.readyState !== EventSource.CLOSED) return; // the browser connects again by itself
  fetch("/admin/account") // a refused stream does not tell why
    .then(({ status }) => leaveIfSignedOut(status))
    .catch(() => {}); // the server is away: the stream is tried again
});

/** @param {number} status of an answer */
function leaveIfSignedOut(status) {
  if (status === 401) location.reload(); // whose answer is the sign-in
}
