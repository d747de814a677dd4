/** Fields that must be filled in are not called invalid before somebody has tried to go on without them. */

/** @param {ParentNode} page */
export function tellInvalidWhenTried(page) {
  for (const field of /** @type {NodeListOf<HTMLInputElement>} */ (page.querySelectorAll("form [required]"))) {
    const tell = (/** @type {boolean} */ isInvalid) => field.setAttribute("aria-invalid", String(isInvalid));
    tell(false);
    field.addEventListener("invalid", () => tell(true));
    field.addEventListener("input", () => tell(false));
  }
}
