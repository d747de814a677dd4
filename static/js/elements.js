/** The elements that a page must have. */

/**
 * Finds an element, or says which one the page lacks.
 * @template {Element} T
 * @param {new () => T} type its class
 * @param {string} selector
 * @param {ParentNode} [parent]
 * @returns {T}
 */
export function required(type, selector, parent = document) {
  const element = parent.querySelector(selector);
  if (element instanceof type) return element;
  throw new Error(`the page has no ${type.name} ${selector}`);
}

/** @param {string} id @returns {HTMLElement} */
export function byId(id) {
  return required(HTMLElement, `#${id}`);
}
