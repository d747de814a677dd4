import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

globalThis.Element = class Element {};
globalThis.HTMLElement = class HTMLElement extends Element {
  tag = "div";
  dataset = {};
  hidden = true;
  className = "";
  textContent = "";
  children = new Map(); // by selector
  focused = 0;
  clicked = 0;
  focus = () => (this.focused += 1);
  click = () => (this.clicked += 1);
  matches = (selector) => selector.split(", ").includes(this.tag);
  querySelector = (selector) => this.children.get(selector)?.[0] ?? null;
  querySelectorAll = (selector) => this.children.get(selector) ?? [];
};
for (const name of ["HTMLInputElement", "HTMLDialogElement"]) globalThis[name] = class extends HTMLElement {};

const NAMES = ["welcome", "trial", "thanks"];
let page, views, headings, buttons, places, dialog, shown;

/** A page of three views with a heading and a main button each, two places to fill, and a fresh module. */
beforeEach(async (context) => {
  const make = (Class, dataset = {}) => Object.assign(new Class(), { dataset });
  page = make(HTMLElement);
  dialog = make(HTMLDialogElement);
  shown = NAMES.map((view) => make(HTMLElement, { view }));
  headings = NAMES.map(() => make(HTMLElement));
  buttons = NAMES.map(() => Object.assign(make(HTMLElement), { hidden: false }));
  places = ["{done} of {total}", "{code}, {total}"].map((fill) => make(HTMLElement, { fill }));
  page.children.set("[data-view]", shown).set("[data-fill]", places);
  NAMES.forEach((name, index) => {
    shown[index].children.set('h1[tabindex="-1"]', [headings[index]]);
    page.children.set(`[data-view="${name}"]`, [shown[index]]);
    page.children.set(`[data-view="${name}"] [data-primary]`, [buttons[index]]);
  });
  const elements = { "#study": page, "#withdraw": dialog };
  const querySelector = (selector) => (selector === "dialog[open]" ? (dialog.open ? dialog : null) : elements[selector] ?? null);
  globalThis.document = { querySelector, documentElement: make(HTMLElement) };
  globalThis.window = { scrollTo: () => {}, addEventListener: () => {}, setTimeout: () => 1 };
  views = await import(`../../../static/js/views.js?test=${encodeURIComponent(context.name)}`);
});

const visible = () => shown.filter((view) => !view.hidden).map((view) => view.dataset.view);
const press = (event) => {
  let isTaken = false;
  views.pressPrimary({ key: "Enter", repeat: false, target: page, preventDefault: () => (isTaken = true), ...event });
  return isTaken;
};

test("one view is shown at a time, with its heading in focus", () => {
  for (const name of ["welcome", "trial", "trial", "thanks", "welcome"]) {
    views.show(name);
    assert.deepEqual(visible(), [name]);
    assert.equal(page.dataset.showing, name);
    assert.equal(page.className, name === "trial" ? "dark" : "light");
  }
  assert.deepEqual(headings.map((heading) => heading.focused), [2, 2, 1]);
});

test("a view at the end stays, whatever is still under way", () => {
  views.showAtTheEnd("thanks");
  views.show("trial");
  assert.deepEqual(visible(), ["thanks"]);
  views.showAtTheEnd("welcome");
  assert.deepEqual(visible(), ["welcome"]);
});

test("a view that the page lacks is named", () => {
  assert.throws(() => views.show("nowhere"), /no HTMLElement \[data-view="nowhere"\]/);
});

test("texts hold the values told so far, and the names of those that were not", () => {
  views.tell({ total: 3 });
  assert.deepEqual(places.map((place) => place.textContent), ["{done} of 3", "{code}, 3"]);
  views.tell({ done: 0, code: "X7" });
  views.tell({ done: 1 });
  assert.deepEqual(places.map((place) => place.textContent), ["1 of 3", "X7, 3"]);
});

test("Enter presses the main button of the view that is shown", () => {
  assert.equal(press({}), false); // no view yet
  views.show("thanks");
  assert.equal(press({}), true);
  assert.deepEqual(buttons.map((button) => button.clicked), [0, 0, 1]);
});

test("Enter is left alone where it means something else", () => {
  views.show("welcome");
  const others = [{ key: " " }, { repeat: true }];
  for (const tag of ["a", "button", "summary", "textarea"]) others.push({ target: Object.assign(new HTMLElement(), { tag }) });
  for (const event of others) assert.equal(press(event), false);
  dialog.open = true;
  assert.equal(press({}), false);
  dialog.open = false;
  buttons[0].hidden = true;
  assert.equal(press({}), false);
  assert.equal(buttons[0].clicked, 0);
});
