// Copies a link or a token, and prints the sheet of invitations. The buttons are hidden where there are no scripts.

const SHOWN_MS = 2000;

for (const element of document.querySelectorAll("[data-copy]")) {
  const button = /** @type {HTMLButtonElement} */ (element);
  button.hidden = false;
  button.addEventListener("click", async () => {
    const copied = await copy(button.dataset.copy ?? "");
    tell(button, copied ? "Copied" : "Press Ctrl+C");
  });
}

const printButton = document.getElementById("print");
if (printButton) {
  printButton.hidden = false;
  printButton.addEventListener("click", () => window.print());
}

/**
 * Copies a text. Without https a browser has no clipboard: then the text is marked, to be copied by the keyboard.
 * @param {string} text
 */
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const shown = [...document.querySelectorAll("a.code, .made code")].find((each) => each.textContent === text);
    if (shown) getSelection()?.selectAllChildren(shown);
    return false;
  }
}

/**
 * @param {HTMLButtonElement} button
 * @param {string} text
 */
function tell(button, text) {
  const status = document.getElementById("copied");
  if (status) status.textContent = text;
  button.textContent = text;
  setTimeout(() => (button.textContent = "Copy"), SHOWN_MS);
}
