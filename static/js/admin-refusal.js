// Why the server refused what a page sent.

/** @param {string} text of the answer @param {number} status @returns {string} a sentence; a proxy answers with a page of its own */
export function reasonIn(text, status) {
  try {
    return String(JSON.parse(text).detail);
  } catch {
    return `The server refused this (${status}${status === 413 ? ", it is too large" : ""}).`;
  }
}
