/** Remembers texts by name: in the browser's storage, or until the page closes where that is refused or full. */

/** @param {() => Storage} storage asked for each time, because even reading the property may be refused */
function remembering(storage) {
  /** @type {Map<string, string>} */
  const here = new Map();
  return {
    /** @param {string} name @returns {string | null} */
    get(name) {
      try {
        return here.get(name) ?? storage().getItem(name); // what is here is newer
      } catch {
        return null;
      }
    },
    /** @param {string} name @param {string} value */
    set(name, value) {
      try {
        storage().setItem(name, value);
        here.delete(name);
      } catch {
        here.set(name, value);
      }
    },
    /** @param {string} name */
    forget(name) {
      here.delete(name);
      try {
        storage().removeItem(name);
      } catch {
        // nothing is kept there
      }
    },
  };
}

export const inBrowser = remembering(() => localStorage);
export const inTab = remembering(() => sessionStorage);
