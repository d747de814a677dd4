// The page to draw on a capture's pictures: strokes on the object and on the background, kept as they are drawn.

import { reasonIn } from "./admin-refusal.js";
import { byId, required } from "./elements.js";
import { Keeper } from "./stroke-keeper.js";
import { erased, extended } from "./stroke-lines.js";

/**
 * @import {Point, Stroke} from "./stroke-lines.js"
 * @typedef {{ sensor: string, side: string, width: number, height: number }} Camera
 * @typedef {Stroke & { sensor: string, side: string, frame: number }} PlacedStroke
 * @typedef {{ base: string, cameras: Camera[], n_frames: number, strokes: PlacedStroke[] }} Data
 */

const COLOURS = { foreground: "rgb(0 200 60 / 85%)", background: "rgb(230 30 30 / 85%)" };
const MASK_COLOUR = [40, 120, 255, 120]; // RGBA where the object is
const STEP = 10; // pixels for each press of an arrow key

/** @type {Data} */
const { base, cameras, n_frames: nFrames, strokes: known } = JSON.parse(byId("drawing-data").textContent);
const tools = required(HTMLFormElement, "#drawing-tools");
const fields = {
  camera: required(HTMLSelectElement, "[name=camera]", tools),
  frame: required(HTMLInputElement, "[name=frame]", tools),
  width: required(HTMLInputElement, "[name=width]", tools),
};
const buttons = {
  undo: required(HTMLButtonElement, "[name=undo]", tools),
  clear: required(HTMLButtonElement, "[name=clear]", tools),
  mask: required(HTMLButtonElement, "[name=mask]", tools),
};
const picture = required(HTMLImageElement, "#drawing-picture");
const canvas = required(HTMLCanvasElement, "#drawing-strokes");
const maskCanvas = required(HTMLCanvasElement, "#drawing-mask");
const state = byId("drawing-state");

/** @type {Map<string, Stroke[]>} by picture */
const drawn = new Map();
/** @type {Map<string, Stroke[][]>} earlier states, by picture */
const earlier = new Map();
const keeper = new Keeper(keep);
/** @type {Point[] | null} the line under the brush */
let line = null;
/** @type {Point | null} where the keyboard's brush is */
let cursor = null;
let isDown = false; // the keyboard's brush

for (const { sensor, side, frame, ...stroke } of known) {
  const key = keyOf(sensor, side, frame);
  drawn.set(key, [...(drawn.get(key) ?? []), stroke]);
}

/** @param {string} sensor @param {string} side @param {number} frame */
function keyOf(sensor, side, frame) {
  return `${sensor}/${side}/${frame}`;
}

function camera() {
  return cameras[Number(fields.camera.value)];
}

function frame() {
  return Math.max(0, Math.min(nFrames - 1, Math.round(Number(fields.frame.value) || 0)));
}

function key() {
  return keyOf(camera().sensor, camera().side, frame());
}

function strokes() {
  return drawn.get(key()) ?? [];
}

/** @returns {string} foreground, background or erase */
function brush() {
  return required(HTMLInputElement, "[name=brush]:checked", tools).value;
}

/** Replaces the strokes of the present picture, and keeps them soon. @param {Stroke[]} next */
function change(next) {
  drawn.set(key(), next);
  hideMask();
  keeper.soon(key());
  draw();
}

function remember() {
  earlier.set(key(), [...(earlier.get(key()) ?? []), strokes()]);
}

/** @param {Point} at */
function begin(at) {
  remember();
  line = [at];
  if (brush() === "erase") erase(at, at);
  draw();
}

/** @param {Point} from @param {Point} to */
function erase(from, to) {
  change(erased(strokes(), from, to, Number(fields.width.value) / 2));
}

/** @param {Point} at */
function goOn(at) {
  if (!line) return;
  if (brush() === "erase") erase(line[line.length - 1], at);
  line = extended(line, at);
  draw();
}

function end() {
  if (!line) return;
  const label = brush();
  const points = line;
  line = null;
  if (label === "foreground" || label === "background") {
    change([...strokes(), { label, points, width: Number(fields.width.value) }]);
  }
  draw();
}

/** Where a pointer is in the picture, pixels. @param {PointerEvent} event @returns {Point} */
function placeOf(event) {
  const box = canvas.getBoundingClientRect();
  return inside([
    ((event.clientX - box.left) / box.width) * canvas.width,
    ((event.clientY - box.top) / box.height) * canvas.height,
  ]);
}

/** @param {Point} point @returns {Point} */
function inside([x, y]) {
  const { width, height } = camera();
  return [Math.round(Math.max(0, Math.min(width - 1, x))), Math.round(Math.max(0, Math.min(height - 1, y)))];
}

function draw() {
  const context = context2d(canvas);
  context.clearRect(0, 0, canvas.width, canvas.height);
  for (const stroke of strokes()) drawLine(context, stroke.points, stroke.width, COLOURS[stroke.label]);
  const label = brush();
  if (line && (label === "foreground" || label === "background")) {
    drawLine(context, line, Number(fields.width.value), COLOURS[label]);
  }
  if (cursor && document.activeElement === canvas) drawCursor(context, cursor);
  tellDrawn();
}

/** @param {CanvasRenderingContext2D} context @param {Point[]} points @param {number} width @param {string} colour */
function drawLine(context, points, width, colour) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineCap = "round";
  context.lineJoin = "round";
  context.beginPath();
  context.moveTo(...points[0]);
  for (const point of points.length > 1 ? points.slice(1) : points) context.lineTo(...point);
  context.stroke();
}

/** @param {CanvasRenderingContext2D} context @param {Point} at */
function drawCursor(context, [x, y]) {
  const radius = Math.max(4, Number(fields.width.value) / 2);
  for (const [colour, width] of /** @type {[string, number][]} */ ([["#000000", 3], ["#ffffff", 1]])) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** @param {HTMLCanvasElement} layer @returns {CanvasRenderingContext2D} */
function context2d(layer) {
  const context = layer.getContext("2d");
  if (!context) throw new Error("this browser cannot draw");
  return context;
}

/** Lists the pictures with strokes, and says what is missing. */
function tellDrawn() {
  const places = [...drawn].filter(([, lines]) => lines.length);
  const items = places.map(([place, lines]) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.className = "button button-small button-quiet";
    button.textContent = place;
    button.addEventListener("click", () => goTo(place));
    const lacks = (["foreground", "background"]).filter((label) => !lines.some((stroke) => stroke.label === label));
    const words = lacks.length ? `, none on the ${lacks[0] === "foreground" ? "object" : "background"} yet` : "";
    item.append(button, ` ${lines.length} ${lines.length === 1 ? "stroke" : "strokes"}${words}`);
    return item;
  });
  byId("drawn-pictures").replaceChildren(...items);
  const missing = cameras
    .map(({ sensor, side }) => `${sensor}/${side}`)
    .filter((name) => !places.some(([place]) => place.startsWith(`${name}/`)));
  byId("drawn-missing").textContent = missing.length
    ? `Every camera needs strokes on at least one frame; missing: ${missing.join(", ")}.`
    : "Every camera has strokes.";
  buttons.undo.disabled = !earlier.get(key())?.length;
  buttons.clear.disabled = !strokes().length;
}

/** @param {string} place sensor/side/frame */
function goTo(place) {
  const [sensor, side, number] = place.split("/");
  fields.camera.value = String(cameras.findIndex((known) => known.sensor === sensor && known.side === side));
  fields.frame.value = number;
  show();
}

/** Shows the chosen picture with its strokes. */
function show() {
  end();
  const { sensor, side, width, height } = camera();
  fields.frame.value = String(frame());
  for (const layer of [canvas, maskCanvas]) {
    layer.width = width;
    layer.height = height;
  }
  picture.width = width;
  picture.height = height;
  byId("drawing").style.setProperty("--ratio", String(width / height));
  picture.src = `${base}/pictures/${sensor}/${side}/${frame()}.jpg`;
  canvas.setAttribute("aria-label", `${sensor}/${side}, frame ${frame()}, to draw on`);
  cursor = [Math.round(width / 2), Math.round(height / 2)];
  isDown = false;
  hideMask();
  draw();
}

function hideMask() {
  maskCanvas.hidden = true;
  tell("");
}

/** Sends a picture's strokes to the server. @param {string} place @returns {Promise<boolean>} whether they are kept */
async function keep(place) {
  const body = JSON.stringify({ strokes: drawn.get(place) ?? [] });
  try {
    const answer = await send("PUT", `${base}/strokes/${place}`, body);
    if (answer.ok) tell("Kept.");
    else tell(reasonIn(await answer.text(), answer.status));
    return answer.ok;
  } catch (error) {
    tell("The server cannot be reached; the strokes are not kept yet.");
    throw error;
  }
}

/** @param {string} method @param {string} address @param {string} [body] */
function send(method, address, body) {
  const headers = { Accept: "application/json", "Content-Type": "application/json", "X-CSRF-Token": tools.dataset.formToken ?? "" };
  return fetch(address, { method, body, headers });
}

/** @param {string} words */
function tell(words) {
  state.textContent = words;
}

/** Shows what the strokes on this picture cut out. */
async function showMask() {
  const place = key();
  if (keeper.lacks(place) && !(await keeper.now(place))) return;
  const asked = drawn.get(place);
  tell("Cutting out…");
  buttons.mask.disabled = true;
  try {
    const answer = await send("POST", `${base}/strokes/${place}/mask`);
    if (place !== key() || asked !== drawn.get(place)) return; // another picture, or other strokes, meanwhile
    if (!answer.ok) return tell(reasonIn(await answer.text(), answer.status));
    const mask = await createImageBitmap(await answer.blob());
    const context = context2d(maskCanvas);
    context.drawImage(mask, 0, 0);
    const pixels = context.getImageData(0, 0, maskCanvas.width, maskCanvas.height);
    let n = 0;
    for (let at = 0; at < pixels.data.length; at += 4) {
      const isObject = pixels.data[at] > 127;
      n += Number(isObject);
      pixels.data.set(isObject ? MASK_COLOUR : [0, 0, 0, 0], at);
    }
    context.putImageData(pixels, 0, 0);
    maskCanvas.hidden = false;
    tell(`The mask is blue: ${((100 * n) / (maskCanvas.width * maskCanvas.height)).toFixed(1)} % of the picture.`);
  } catch {
    tell("The server cannot be reached. Please try again.");
  } finally {
    buttons.mask.disabled = false;
  }
}

function undo() {
  const states = earlier.get(key()) ?? [];
  const before = states.at(-1);
  if (!before) return;
  earlier.set(key(), states.slice(0, -1));
  change(before);
}

/** @param {string} value */
function choose(value) {
  required(HTMLInputElement, `[name=brush][value=${value}]`, tools).checked = true;
  draw();
}

/** @type {Record<string, () => void>} */
const KEYS = {
  f: () => choose("foreground"),
  b: () => choose("background"),
  e: () => choose("erase"),
  z: undo,
  m: showMask,
  "[": () => widen(-1),
  "]": () => widen(1),
  PageUp: () => step(-1),
  PageDown: () => step(1),
  " ": press,
};
/** @type {Record<string, Point>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** @param {number} by */
function widen(by) {
  fields.width.value = String(Number(fields.width.value) + by);
  draw();
}

/** @param {number} by */
function step(by) {
  end(); // a line that is begun belongs to this frame
  fields.frame.value = String(frame() + by);
  show();
}

/** Puts the keyboard's brush down, or lifts it. */
function press() {
  if (!cursor) return;
  isDown = !isDown;
  if (isDown) begin(cursor);
  else end();
}

canvas.addEventListener("keydown", (event) => {
  const arrow = ARROWS[event.key];
  const act = event.ctrlKey || event.metaKey || event.altKey ? undefined : KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!arrow && !act) return;
  event.preventDefault();
  if (act) return act();
  if (!cursor) return;
  const length = event.shiftKey ? 1 : STEP;
  cursor = inside([cursor[0] + length * arrow[0], cursor[1] + length * arrow[1]]);
  if (isDown) goOn(cursor);
  draw();
});
canvas.addEventListener("focus", draw);
canvas.addEventListener("blur", () => {
  if (isDown) press();
  draw();
});
canvas.addEventListener("pointerdown", (event) => {
  if (event.button !== 0) return;
  canvas.setPointerCapture(event.pointerId);
  begin(placeOf(event));
});
canvas.addEventListener("pointermove", (event) => {
  if (canvas.hasPointerCapture(event.pointerId)) goOn(placeOf(event));
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, end);
tools.addEventListener("submit", (event) => event.preventDefault());
fields.camera.addEventListener("change", show);
fields.frame.addEventListener("change", show);
buttons.undo.addEventListener("click", undo);
buttons.clear.addEventListener("click", () => {
  remember();
  change([]);
});
buttons.mask.addEventListener("click", showMask);
picture.addEventListener("error", () => tell("This picture cannot be shown; the job “Check a capture” says what is wrong with it."));
window.addEventListener("beforeunload", (event) => {
  if (!keeper.isDone) event.preventDefault(); // it is a matter of half a second
});
show();
