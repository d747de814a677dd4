// Tells every time in the reader's own time zone; without this, pages tell UTC, and say so.

const UTC = " UTC"; // what the server writes behind a time

/** @param {Date} at @param {string | undefined} zone @param {boolean} withSeconds */
function told(at, zone, withSeconds) {
  const second = withSeconds ? /** @type {const} */ ("2-digit") : undefined;
  const parts = { year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit" };
  const options = /** @type {Intl.DateTimeFormatOptions} */ ({ ...parts, second, timeZone: zone });
  return new Intl.DateTimeFormat("sv-SE", options).format(at); // year-month-day, which nobody can misread
}

/** @param {ParentNode} within */
function tellTimes(within) {
  for (const time of within.querySelectorAll("time")) {
    const text = time.textContent ?? "";
    if (!text.endsWith(UTC)) continue; // told before
    const at = new Date(time.dateTime);
    const withSeconds = text.length > "2000-01-01 00:00 UTC".length;
    time.textContent = told(at, undefined, withSeconds);
    time.title = told(at, "UTC", withSeconds) + UTC;
  }
}

tellTimes(document);
new MutationObserver(() => tellTimes(document)).observe(document.body, { childList: true, subtree: true }); // live pages
