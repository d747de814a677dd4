// A new study's first step: a zip file, films or folders are dropped or chosen; films get the names of their scene and
// condition, are packed, and sent.

import { sendFile } from "./admin-upload.js";
import { byId, required } from "./elements.js";
import { faults, named } from "./film-names.js";
import { packed } from "./zip.js";

const FILM = /\.(mp4|mov|m4v|mkv|webm|avi)$/i;
const form = required(HTMLFormElement, "#upload-form");
const box = byId("drop");
const table = byId("names");
const rows = required(HTMLTableSectionElement, "tbody", table);
const words = byId("names-faults");
const begin = required(HTMLButtonElement, "button", table);
let films = /** @type {import("./film-names.js").NamedFilm[]} */ ([]);

for (const input of box.querySelectorAll("input")) {
  const chosen = () => take([...(input.files ?? [])].map((file) => ({ path: file.webkitRelativePath || file.name, file })));
  input.addEventListener("change", chosen);
  if (input.files?.length) setTimeout(chosen); // before this script was there, and once all of it is
}
box.addEventListener("dragover", (event) => {
  event.preventDefault();
  box.dataset.over = "";
});
box.addEventListener("dragleave", () => delete box.dataset.over);
box.addEventListener("drop", async (event) => {
  event.preventDefault();
  delete box.dataset.over;
  const entries = [...(event.dataTransfer?.items ?? [])].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  take((await Promise.all(entries.map(filesIn))).flat());
});
begin.addEventListener("click", send);

/** @param {{ path: string, file: File }[]} given */
function take(given) {
  const zip = given.find(({ path }) => /\.zip$/i.test(path));
  required(HTMLInputElement, "[name=name]", form).value = (zip ? zip.file.name.replace(/\.zip$/i, "") : folderOf(given.map(({ path }) => path))).slice(0, 100);
  if (zip) return sendFile(form, zip.file);
  const found = given.filter(({ path }) => FILM.test(path) && !/(^|\/)\./.test(path));
  if (!found.length) return tell("There is no film among these: expected mp4, mov, m4v, mkv, webm or avi, or a zip file.");
  const guess = named(found);
  films = guess.films;
  if (guess.isSure) return send();
  ask();
}

/** The folder that holds all folders of scenes; empty: there is none. @param {string[]} paths */
function folderOf(paths) {
  const [first = "", ...below] = paths[0]?.split("/") ?? [];
  return below.length > 1 && paths.every((path) => path.startsWith(`${first}/`)) ? first : "";
}

/** Shows the table of names, to be corrected. */
function ask() {
  table.hidden = false;
  rows.replaceChildren(
    ...films.map((film) => {
      const row = document.createElement("tr");
      const head = document.createElement("th");
      head.scope = "row";
      head.textContent = film.path;
      row.append(head);
      for (const key of /** @type {("dataset" | "condition")[]} */ (["dataset", "condition"])) {
        const input = document.createElement("input");
        input.className = "field field-small";
        input.maxLength = 100;
        input.value = film[key];
        input.setAttribute("aria-label", `${key === "dataset" ? "Scene" : "Condition"} of ${film.path}`);
        input.addEventListener("input", () => {
          film[key] = input.value.trim();
          judge();
        });
        const cell = document.createElement("td");
        cell.className = "text";
        cell.append(input);
        row.append(cell);
      }
      return row;
    }),
  );
  judge();
  table.scrollIntoView({ block: "nearest" });
}

function judge() {
  const found = faults(films);
  words.textContent = found.join(" ");
  begin.disabled = found.length > 0;
}

async function send() {
  const entries = films.map(({ dataset, condition, path, file }) => ({
    name: `${plain(dataset)}/${plain(condition)}${path.slice(path.lastIndexOf(".")).toLowerCase()}`,
    file,
  }));
  try {
    begin.disabled = true;
    tell("Packing the films");
    sendFile(form, await packed(entries, (share) => tell(`Packing the films: ${Math.round(100 * share)} %`)));
  } catch (error) {
    begin.disabled = false;
    tell(error instanceof Error ? error.message : String(error));
  }
}

/** @param {string} name */
function plain(name) {
  return name.replaceAll(/[/\\]/g, "-");
}

/** @param {string} text */
function tell(text) {
  const state = byId("upload-state");
  state.hidden = false;
  required(HTMLElement, "span", state).textContent = text;
}

/** Files of a dropped file or folder. @param {FileSystemEntry} entry @returns {Promise<{ path: string, file: File }[]>} */
async function filesIn(entry) {
  if (entry.isFile) {
    const file = await new Promise((done, fail) => /** @type {FileSystemFileEntry} */ (entry).file(done, fail));
    return [{ path: entry.fullPath.slice(1), file }];
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader();
  const found = [];
  for (;;) {
    const some = await new Promise((done, fail) => reader.readEntries(done, fail)); // at most 100 at a time
    if (!some.length) return (await Promise.all(found.map(filesIn))).flat();
    found.push(...some);
  }
}
