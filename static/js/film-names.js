// Guesses of films that were dropped which scene each shows, and in which condition; a table asks where that is not clear.

const SEPARATORS = ["__", "_", "-", " "];

/** @typedef {{ path: string, file: File, dataset: string, condition: string }} NamedFilm */

/**
 * Names films: by their folder, else by a part of their names that makes every scene have every condition.
 * @param {{ path: string, file: File }[]} films
 * @returns {{ films: NamedFilm[], isSure: boolean }}
 */
export function named(films) {
  const parts = films.map(({ path }) => path.split("/").filter(Boolean));
  if (parts.every((each) => each.length > 1)) {
    const byFolder = films.map((film, i) => ({ ...film, dataset: parts[i].at(-2) ?? "", condition: stem(film.path) }));
    return { films: byFolder, isSure: !faults(byFolder).length };
  }
  for (const separator of SEPARATORS) {
    for (const find of ["lastIndexOf", "indexOf"]) {
      const split = films.map((film) => {
        const name = stem(film.path);
        const at = find === "indexOf" ? name.indexOf(separator) : name.lastIndexOf(separator);
        return { ...film, dataset: name.slice(0, Math.max(at, 0)), condition: at < 0 ? "" : name.slice(at + separator.length) };
      });
      if (!faults(split).length) return { films: split, isSure: false };
    }
  }
  return { films: films.map((film) => ({ ...film, dataset: "scene", condition: stem(film.path) })), isSure: false };
}

/** What is wrong with names, in sentences. @param {NamedFilm[]} films @returns {string[]} */
export function faults(films) {
  const found = [];
  const unnamed = films.filter(({ dataset, condition }) => !dataset.trim() || !condition.trim());
  if (unnamed.length) found.push(`${unnamed[0].path} has no scene or no condition.`);
  const conditions = new Set(films.map(({ condition }) => condition));
  for (const dataset of new Set(films.map((film) => film.dataset))) {
    const own = films.filter((film) => film.dataset === dataset).map(({ condition }) => condition);
    const twice = own.find((condition, i) => own.indexOf(condition) !== i);
    const missing = [...conditions].filter((condition) => !own.includes(condition));
    if (twice !== undefined) found.push(`${dataset} has two films of ${twice}.`);
    else if (missing.length) found.push(`${dataset} has no film of ${missing.join(", ")}.`);
  }
  if (conditions.size < 2) found.push("There is one condition: expected two or more to compare.");
  return found;
}

/** @param {string} path */
function stem(path) {
  return (path.split("/").at(-1) ?? "").replace(/\.[^.]*$/, "");
}
