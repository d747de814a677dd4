// Models in three dimensions: two views whose cameras move together, drawn when something has changed.

import {
  AmbientLight,
  BufferAttribute,
  Color,
  DirectionalLight,
  DoubleSide,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  PerspectiveCamera,
  Points,
  PointsMaterial,
  Scene,
  Vector3,
  WebGLRenderer,
} from "/static/vendor/three.module.min.js";
import { OrbitControls } from "/static/vendor/OrbitControls.js";
import { PLYLoader } from "/static/vendor/PLYLoader.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("models-form"));
const fault = document.getElementById("models-fault");
const scale = document.getElementById("errors-scale");
/** @type {{dataset: string, condition: string, kind: string, n_points: number, n_faces: number, error_limit_mm: number | null, url: string}[]} */
const models = JSON.parse(document.getElementById("models-data").textContent);

// The colours of recon.geometry.mesh.error_colours, as sRGB because its bytes are what is mixed there.
const RED = new Color(178 / 255, 24 / 255, 43 / 255);
const BLUE = new Color(33 / 255, 102 / 255, 172 / 255);
const WHITE = new Color(1, 1, 1);
const GROUND = "#f1efe9"; // --paper-sunken
const PLAIN = "#b9b4a8";
const TURN = Math.PI / 36; // of an arrow key
const STEP = 0.9; // of the distance, for + and -
const FIELD_OF_VIEW = 35; // degrees
const NAMES = { mesh: "triangles", cloud: "points" };

/** One canvas with its camera and the model in it. */
class View {
  /** @param {HTMLElement} figure */
  constructor(figure) {
    this.figure = figure;
    this.canvas = figure.querySelector("canvas");
    this.facts = figure.querySelector("[data-facts]");
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene = new Scene();
    this.scene.background = new Color(GROUND);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1e6);
    const lamp = new DirectionalLight("#ffffff", 2.4);
    this.camera.add(lamp);
    this.scene.add(this.camera, new AmbientLight("#ffffff", 0.9));
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.object = null;
    this.isAsked = false;
    this.controls.addEventListener("change", () => {
      link(this);
      this.draw();
    });
    this.canvas.addEventListener("keydown", (event) => onKey(this, event));
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      tell("The graphics card gave up this view. Load the page again.");
    });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  draw() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      const { clientWidth, clientHeight } = this.canvas;
      this.renderer.setSize(clientWidth, clientHeight, false);
      this.camera.aspect = clientWidth / clientHeight;
      this.camera.updateProjectionMatrix();
      this.renderer.render(this.scene, this.camera);
    });
  }

  /** @param {typeof models[number] | undefined} model */
  async show(model) {
    this.wanted = model?.url;
    this.facts.textContent = model ? "" : "no such model";
    this.put(null);
    this.figure.classList.toggle("is-loading", Boolean(model));
    if (!model) return;
    try {
      const geometry = await read(model.url);
      if (this.wanted !== model.url) return; // another one was chosen meanwhile
      this.put(geometry);
      const limit = model.error_limit_mm;
      const n = model.kind === "mesh" ? model.n_faces : model.n_points;
      const near = limit === null ? "" : `, 95 % within ${limit.toFixed(1)} mm`;
      this.facts.textContent = `${n.toLocaleString("en")} ${NAMES[model.kind]}${near}`;
      this.canvas.setAttribute("aria-label", `${model.kind} of ${model.dataset} by ${model.condition}`);
    } catch {
      if (this.wanted === model.url) this.facts.textContent = "could not be loaded; choose it again later";
    } finally {
      if (this.wanted === model.url) this.figure.classList.remove("is-loading");
    }
  }

  /** Put a geometry in place of what is there. @param {import("three").BufferGeometry | null} geometry */
  put(geometry) {
    if (this.object) {
      this.scene.remove(this.object);
      this.object.material.dispose();
    }
    this.object = geometry && (geometry.index ? new Mesh(geometry) : new Points(geometry));
    if (this.object) this.scene.add(this.object);
    this.paint();
  }

  paint() {
    if (!this.object) return this.draw();
    const { geometry } = this.object;
    const wanted = form.elements.colours.value;
    const values = wanted === "error" ? errorColours(geometry.getAttribute("error")) : geometry.userData.own;
    const hasColours = wanted !== "shape" && Boolean(values);
    if (hasColours) geometry.setAttribute("color", values);
    const options = { vertexColors: hasColours, color: hasColours ? "#ffffff" : PLAIN };
    this.object.material?.dispose();
    if (!geometry.index) this.object.material = new PointsMaterial({ ...options, size: 2, sizeAttenuation: false });
    else if (wanted === "own" && hasColours) this.object.material = new MeshBasicMaterial({ ...options, side: DoubleSide });
    else this.object.material = new MeshLambertMaterial({ ...options, side: DoubleSide });
    this.draw();
  }

  /** Look at the middle of the model from the front. */
  reset() {
    const sphere = (this.object ?? other(this).object)?.geometry.boundingSphere;
    if (!sphere) return;
    const { clientWidth, clientHeight } = this.canvas;
    const half = Math.tan((FIELD_OF_VIEW * Math.PI) / 360) * Math.min(1, clientWidth / clientHeight);
    const away = sphere.radius / Math.sin(Math.atan(half)); // the whole model is in the picture
    this.camera.near = away / 100;
    this.camera.far = away * 100;
    this.controls.target.copy(sphere.center);
    this.camera.position.copy(sphere.center).add(new Vector3(0, 0, away));
    this.controls.update();
    this.draw();
  }
}

/** @type {Map<string, Promise<any>>} */
const geometries = new Map();

/** A model's geometry, fetched until it has come once. @param {string} url */
function read(url) {
  if (!geometries.has(url)) {
    const loader = new PLYLoader();
    loader.setCustomPropertyNameMapping({ error: ["error"] });
    const geometry = loader.loadAsync(url).then(prepared);
    geometry.catch(() => geometries.delete(url));
    geometries.set(url, geometry);
  }
  return geometries.get(url);
}

function prepared(geometry) {
  if (geometry.index && !geometry.getAttribute("normal")) geometry.computeVertexNormals();
  geometry.computeBoundingSphere();
  geometry.userData.own = geometry.getAttribute("color");
  return geometry;
}

/** Blue inside the truth, white on it, red outside. */
function errorColours(errors) {
  if (!errors) return null;
  const limit = limitMm();
  const colours = new Float32Array(3 * errors.count);
  const mixed = new Color();
  for (let index = 0; index < errors.count; index++) {
    const share = Math.max(-1, Math.min(1, errors.getX(index) / limit));
    mixed.lerpColors(WHITE, share > 0 ? RED : BLUE, Math.abs(share)).convertSRGBToLinear();
    mixed.toArray(colours, 3 * index);
  }
  return new BufferAttribute(colours, 3);
}

/** The error that has the full colour: the slider's middle is the larger of both models' 95 %. */
function limitMm() {
  const limits = chosen().map((model) => model?.error_limit_mm ?? 0);
  const middle = Math.max(...limits) || 1;
  return middle * 10 ** ((Number(form.elements.limit.value) - 50) / 50);
}

function chosen() {
  const { dataset, kind, left, right } = form.elements;
  return [left, right].map((select) =>
    models.find((one) => one.dataset === dataset.value && one.kind === kind.value && one.condition === select.value),
  );
}

/** @param {View} of */
const other = (of) => (of === views[0] ? views[1] : views[0]);

/** Let the other camera stand where this one does. @param {View} moved */
function link(moved) {
  if (!form.elements.linked.checked) return;
  const { camera, controls } = other(moved);
  if (camera.position.equals(moved.camera.position) && controls.target.equals(moved.controls.target)) return;
  camera.position.copy(moved.camera.position);
  camera.quaternion.copy(moved.camera.quaternion);
  camera.near = moved.camera.near;
  camera.far = moved.camera.far;
  controls.target.copy(moved.controls.target);
  other(moved).draw();
}

/** @param {View} view @param {KeyboardEvent} event */
function onKey(view, event) {
  const across = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0;
  const along = { ArrowUp: -1, ArrowDown: 1 }[event.key] ?? 0;
  const nearer = { "+": STEP, "=": STEP, "-": 1 / STEP }[event.key];
  if (!across && !along && !nearer && event.key !== "Home") return;
  event.preventDefault();
  const { camera, controls } = view;
  if (event.key === "Home") view.reset();
  else if (event.shiftKey && !nearer) move(view, across, along);
  else turn(camera, controls.target, TURN * across, TURN * along, nearer ?? 1);
  controls.update();
  link(view);
  view.draw();
}

/** Turn a camera about its target, and change its distance. */
function turn(camera, target, across, along, by) {
  const apart = camera.position.clone().sub(target);
  const side = new Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
  apart.applyAxisAngle(camera.up, across);
  const raised = apart.clone().applyAxisAngle(side, along);
  if (raised.angleTo(camera.up) > TURN && raised.angleTo(camera.up) < Math.PI - TURN) apart.copy(raised);
  camera.position.copy(target).add(apart.multiplyScalar(by));
  camera.lookAt(target);
}

/** @param {View} view */
function move({ camera, controls }, across, along) {
  const by = camera.position.distanceTo(controls.target) / 20;
  const step = new Vector3(by * across, -by * along, 0).applyQuaternion(camera.quaternion);
  camera.position.add(step);
  controls.target.add(step);
}

/** @param {string} reason */
function tell(reason) {
  fault.textContent = reason;
  fault.hidden = false;
}

function fillConditions() {
  const { dataset, kind, left, right } = form.elements;
  const there = models.filter((one) => one.dataset === dataset.value && one.kind === kind.value);
  [left, right].forEach((select, side) => {
    const before = select.value;
    select.replaceChildren(...there.map((one) => new Option(one.condition)));
    const kept = there.some((one) => one.condition === before);
    select.value = kept ? before : (there[side] ?? there[0])?.condition;
  });
}

async function showChosen({ isOtherScene = false } = {}) {
  tellScale();
  await Promise.all(chosen().map((model, side) => views[side].show(model)));
  if (isOtherScene) views.forEach((view) => view.reset());
}

function tellScale() {
  const known = chosen().some((model) => model?.error_limit_mm != null);
  const option = form.elements.colours.querySelector("[value=error]");
  option.disabled = !known;
  if (!known && form.elements.colours.value === "error") form.elements.colours.value = "own";
  scale.hidden = form.elements.colours.value !== "error";
  form.elements["limit-mm"].value = `± ${limitMm().toPrecision(2)} mm`;
}

function start() {
  for (const kind of ["mesh", "cloud"])
    form.elements.kind.querySelector(`[value=${kind}]`).disabled = !models.some((one) => one.kind === kind);
  form.elements.kind.value = models.some((one) => one.kind === "mesh") ? "mesh" : "cloud";
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", (event) => {
    event.preventDefault(); // the choices stay
    views.forEach((view) => view.reset());
  });
  document.addEventListener("input", ({ target }) => {
    if (target.form !== form) return;
    const isOtherScene = target.name === "dataset";
    if (isOtherScene || target.name === "kind") fillConditions();
    if (["dataset", "kind", "left", "right"].includes(target.name)) showChosen({ isOtherScene });
    else if (target.name === "linked") link(views[0]);
    else {
      tellScale();
      views.forEach((view) => view.paint());
    }
  });
  fillConditions();
  showChosen({ isOtherScene: true });
}

/** @type {View[]} */
let views = [];
if (document.createElement("canvas").getContext("webgl2")) {
  views = [...document.querySelectorAll("#models figure")].map((figure) => new View(figure));
  start();
} else {
  document.getElementById("models").hidden = form.hidden = true;
  document.getElementById("models-keys").hidden = true;
  tell("This browser shows no 3D (WebGL 2 is missing or switched off). The models can be downloaded below.");
}
