// Leads from a page that updates itself to the sign-in once its reader is signed out; else the page would just stand still.

document.addEventListener("htmx:responseError", (event) => {
  const { xhr } = /** @type {CustomEvent<{xhr: XMLHttpRequest}>} */ (event).detail;
  leaveIfSignedOut(xhr.status);
});

document.addEventListener("htmx:sseError", (event) => {
  const { source } = /** @type {CustomEvent<{source: EventSource}>} */ (event).detail;
  if (source.readyState !== EventSource.CLOSED) return; // the browser connects again by itself
  fetch("/admin/account") // the stream's error has no status
    .then(({ status }) => leaveIfSignedOut(status))
    .catch(() => {}); // the server is away: the stream is tried again
});

/** @param {number} status of a response */
function leaveIfSignedOut(status) {
  if (status === 401) location.reload(); // answered with the sign-in page
}
