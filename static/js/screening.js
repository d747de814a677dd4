/** The screening: the display's size, the distance of the eyes, rings and plates. Only the server knows the right answers. */

import { BankCard } from "./bank-card.js";
import { fitsBlindSpot, watchDot } from "./blind-spot.js";
import { Refusal, patiently } from "./connection.js";
import { listenForDirections } from "./directions.js";
import { byId, required } from "./elements.js";
import { PixelStage } from "./pixel-stage.js";
import { answerItem, readItem, readPicture, readScreening, sendCard, sendDistance, skipTest } from "./session.js";
import { enterFullScreen } from "./page.js";
import { isSettling, settle } from "./settling.js";
import { tenths } from "./viewing.js";
import { isDialogOpen, openDialog } from "./views.js";

/**
 * @typedef {import("./session.js").ScreeningState} ScreeningState
 * @typedef {import("./session.js").Certificate} Certificate
 * @typedef {import("./session.js").ScreeningItem} ScreeningItem
 * @typedef {object} Page how the page is changed
 * @property {(view: string) => void} show
 * @property {(values: Record<string, unknown>) => void} tell for the places in the texts
 * @property {() => string | undefined} showing the view that is shown
 */

const N_CARDS = 2;
const N_BLIND_SPOTS = 5;
const NO_ROOM = "no-room"; // the view that asks for more
const LEAST_ROOM = { width: 320, height: 420 }; // CSS pixels: the dial takes 230 of the height
const BLANK_MS = 250; // between pictures

/** Takes a participant through every test that is not over yet, and back to the seat. @param {Page} page */
export async function takeScreening(page) {
  const state = await patiently(readScreening);
  if (state.tests.some((test) => !test.is_over)) {
    page.show("screening");
    await pressed("begin-screening");
    enterFullScreen();
  }
  for (const { test, has_begun, is_over } of state.tests) {
    if (is_over) continue;
    if (test === "acuity") await takeRings(page, state, has_begun);
    else await takePlates(page);
  }
  if (!(await knowsSeat(page))) return;
  page.show("seat");
  await pressed("confirm-seat");
  enterFullScreen();
}

/** Tells how far from the display the participant sits. @param {Page} page @returns {Promise<boolean>} false where that was not measured */
async function knowsSeat(page) {
  const { seat_cm } = await patiently(readScreening);
  page.tell({ seat_cm });
  return seat_cm !== null;
}

/** @param {Page} page @param {ScreeningState} state @param {boolean} hasBegun then the display and the distance are measured already */
async function takeRings(page, state, hasBegun) {
  const certificate = hasBegun ? certificateOf(state) : await measure(page, state);
  if (!certificate) {
    await patiently(() => skipTest("acuity", "no card"));
    return;
  }
  page.tell({ ...certificate });
  byId("cannot-certify").hidden = certificate.can_certify;
  page.show("rings-intro");
  await pressed("begin-rings");
  const stage = new PixelStage(required(HTMLCanvasElement, "#ring-canvas"));
  await takeItems(page, "acuity", "rings", (picture) => stage.show(picture), () => stage.clear());
}

/** @param {Page} page */
async function takePlates(page) {
  byId("plates-seat").hidden = !(await knowsSeat(page));
  page.show("plates-intro");
  await pressed("begin-plates");
  const plate = required(HTMLImageElement, "#plate");
  const showPlate = async (/** @type {Blob} */ picture) => {
    plate.src = URL.createObjectURL(picture);
    await plate.decode();
    URL.revokeObjectURL(plate.src);
    plate.hidden = false;
  };
  const hidePlate = () => {
    plate.hidden = true;
  };
  await takeItems(page, "colour", "plates", showPlate, hidePlate);
}

/**
 * Shows a test's pictures, one after the other, and sends the answers until the server has no more pictures.
 * @param {Page} page @param {string} test @param {string} view
 * @param {(picture: Blob) => Promise<void>} draw @param {() => void} blank
 */
async function takeItems(page, test, view, draw, blank) {
  let item = await patiently(() => readItem(test));
  if (item) page.tell({ item: item.number, items: item.total });
  page.show(hasRoom() ? view : NO_ROOM);
  const listening = new AbortController();
  const look = () => [view, NO_ROOM].includes(String(page.showing())) && page.show(hasRoom() ? view : NO_ROOM);
  window.addEventListener("resize", look, { signal: listening.signal });
  while (item) {
    const shown = item;
    page.tell({ item: shown.number, items: shown.total });
    await draw(await patiently(() => readPicture(shown.picture)));
    settle();
    const answer = await answered(page, view, shown);
    blank();
    const pause = new Promise((resolve) => setTimeout(resolve, BLANK_MS));
    item = await patiently(() => answerItem(test, shown.number, answer));
    await pause;
  }
  listening.abort();
}

/**
 * @param {Page} page @param {string} view @param {ScreeningItem} item
 * @returns {Promise<{answer: number | null, response_ms: number}>} by dial or by key
 */
function answered(page, view, item) {
  const shownAt = performance.now();
  const dial = required(HTMLElement, `[data-view="${view}"] .dial`);
  return new Promise((resolve) => {
    const listening = new AbortController();
    const give = (/** @type {number | null} */ answer) => {
      if (isSettling()) return;
      if (answer === null ? !item.may_be_nothing : !item.choices.includes(answer)) return;
      listening.abort();
      stopKeys();
      resolve({ answer, response_ms: tenths(performance.now() - shownAt) });
    };
    const stopKeys = listenForDirections(give, () => page.showing() === view && !isDialogOpen());
    const press = (/** @type {Event} */ event) => {
      const button = event.target instanceof Element ? event.target.closest("button") : null;
      if (button) give(button.dataset.direction === "" ? null : Number(button.dataset.direction));
    };
    dial.addEventListener("click", press, { signal: listening.signal });
  });
}

/** Whether a picture and its dial stand in the window without covering each other. */
function hasRoom() {
  return innerHeight >= LEAST_ROOM.height && innerWidth >= LEAST_ROOM.width;
}

/** Measures the display's size and the distance of the eyes. @param {Page} page @param {ScreeningState} state @returns {Promise<Certificate | null>} null: there is no card */
async function measure(page, state) {
  const measured = await fitCards(page);
  if (!measured) return null;
  if (measured.certificate) return measured.certificate; // the distance is fixed
  const certificate = await (state.distance === "blind spot" ? findBlindSpot(page, measured) : typeDistance(page, "distance"));
  return certificate.can_certify ? certificate : stepBack(page, certificate, measured);
}

/** @param {Page} page @returns {Promise<ScreeningState | null>} null: there is no card */
async function fitCards(page) {
  card ??= new BankCard(byId("card-fitting"));
  byId("no-card").onclick = () => openDialog("without-card");
  byId("card-again").hidden = true;
  for (;;) {
    const card_widths = [];
    while (card_widths.length < N_CARDS) {
      page.tell({ card: card_widths.length + 1 });
      page.show("card");
      card.startAnew();
      if ((await pressed("card-fits", "no-card-yes")) === "no-card-yes") return null;
      card_widths.push(card.width);
    }
    const facts = { card_widths, device_pixel_ratio: devicePixelRatio, window_height: innerHeight };
    const measured = await unlessImplausible(() => sendCard(facts));
    if (measured) return measured;
    byId("card-again").hidden = false;
  }
}

/** @type {BankCard | undefined} */
let card;

/**
 * @template {string} [T=never] @param {Page} page @param {"distance" | "step-back"} view with a form of the same name
 * @param {Promise<T>} [orElse] what may be pressed instead; a distance that was sent before counts all the same
 * @returns {Promise<Certificate | T>}
 */
async function typeDistance(page, view, orElse = new Promise(() => {})) {
  const form = required(HTMLFormElement, `#${view}-form`);
  const again = byId(`${view}-again`);
  again.hidden = true;
  for (;;) {
    page.show(view);
    const given = await Promise.race([submittedNumber(form), orElse]);
    if (typeof given === "string") return given;
    const measured = await unlessImplausible(() => sendDistance({ typed_cm: given }));
    if (measured) return certificateOf(measured);
    again.hidden = false;
  }
}

/** @param {Page} page @param {ScreeningState} state @returns {Promise<Certificate>} */
async function findBlindSpot(page, state) {
  const device_pixel_ratio = devicePixelRatio;
  byId("blind-again").hidden = true;
  for (;;) {
    page.show("blind-intro");
    await pressed("begin-blind");
    /** @type {number[]} CSS pixels */
    const blind_spots = [];
    while (blind_spots.length < N_BLIND_SPOTS) {
      page.tell({ spot: blind_spots.length + 1, spots: N_BLIND_SPOTS });
      if (page.showing() !== "blind") page.show("blind");
      blind_spots.push(await watchDot(byId("blind-field"), cssPixelMm(state), () => page.showing() === "blind" && !isDialogOpen()));
    }
    const measured = await unlessImplausible(() => sendDistance({ blind_spots, device_pixel_ratio }));
    if (measured) return certificateOf(measured);
    byId("blind-again").hidden = false;
  }
}

/**
 * Asks to sit farther away: from here the display's pixels are too large for a certificate. The new distance is measured
 * like the first one, where the display is wide enough for a blind spot from there; else it is typed.
 * @param {Page} page @param {Certificate} certificate @param {ScreeningState} state @returns {Promise<Certificate>}
 */
async function stepBack(page, certificate, state) {
  let current = certificate;
  const stay = pressed("stay");
  while (!current.can_certify) {
    const isMeasured = state.distance === "blind spot" && fitsBlindSpot(current.needed_distance_cm, cssPixelMm(state));
    page.tell({ ...current });
    for (const id of ["step-back-form", "new-distance"]) byId(id).hidden = isMeasured;
    byId("moved-back").hidden = !isMeasured;
    const next = await (isMeasured ? measureAgain(page, state, stay) : typeDistance(page, "step-back", stay));
    if (typeof next === "string") break;
    current = next;
  }
  return current;
}

/** @param {Page} page @param {ScreeningState} state @param {Promise<string>} stay */
async function measureAgain(page, state, stay) {
  page.show("step-back");
  const choice = await Promise.race([pressed("moved-back"), stay]);
  return choice === "moved-back" ? findBlindSpot(page, state) : choice;
}

/** @param {ScreeningState} state @returns {number} */
function cssPixelMm({ pixel_mm }) {
  return Number(pixel_mm) * devicePixelRatio;
}

/** @param {ScreeningState} state @returns {Certificate} */
function certificateOf({ certificate }) {
  if (!certificate) throw new Error("the distance was taken, and there is no certificate");
  return certificate;
}

/** @template T @param {() => Promise<T>} send @returns {Promise<T | null>} null when the server finds it implausible */
async function unlessImplausible(send) {
  try {
    return await patiently(send);
  } catch (error) {
    if (error instanceof Refusal && error.status === 422) return null;
    throw error;
  }
}

/** @param {...string} ids of buttons @returns {Promise<string>} id of the button that is pressed first */
function pressed(...ids) {
  return new Promise((resolve) => {
    const listening = new AbortController();
    for (const id of ids) {
      const press = () => {
        listening.abort();
        resolve(id);
      };
      byId(id).addEventListener("click", press, { signal: listening.signal });
    }
  });
}

/** @param {HTMLFormElement} form with one number @returns {Promise<number>} */
function submittedNumber(form) {
  return new Promise((resolve) => {
    const submit = () => {
      const field = required(HTMLInputElement, "input[type=number]", form);
      if (!form.reportValidity()) return;
      form.removeEventListener("submit", submit);
      resolve(field.valueAsNumber);
    };
    form.addEventListener("submit", submit);
  });
}

