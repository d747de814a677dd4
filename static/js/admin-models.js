// Shows two models in 3D, side by side. Their cameras move together; a view is drawn when something has changed.

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
  Sphere,
  Vector3,
  WebGLRenderer,
} from "/static/vendor/three.module.min.js";
import { OrbitControls } from "/static/vendor/OrbitControls.js";
import { PLYLoader } from "/static/vendor/PLYLoader.js";
import { byId, required } from "./elements.js";

/**
 * @import {BufferGeometry, Camera, Material} from "/static/vendor/three.module.min.js"
 * @import {SparkRenderer, SplatMesh} from "/static/vendor/spark.js"
 * @typedef {object} Model
 * @property {string} dataset
 * @property {string} condition
 * @property {"mesh" | "cloud" | "splat"} kind
 * @property {number} n_points
 * @property {number} n_faces
 * @property {number | null} error_limit_mm within which 95 % of the points are; null where the truth is not known
 * @property {string} url
 */

const form = required(HTMLFormElement, "#models-form");
const controls = {
  dataset: select("dataset"),
  kind: select("kind"),
  colours: select("colours"),
  linked: required(HTMLInputElement, "[name=linked]"),
  limit: required(HTMLInputElement, "[name=limit]"),
  limitMm: required(HTMLOutputElement, "[name=limit-mm]"),
};
const conditions = [select("left"), select("right")];
/** @type {Model[]} */
const models = JSON.parse(byId("models-data").textContent);

// The colours of recon.geometry.mesh.error_colours, which mixes sRGB values.
const RED = new Color(178 / 255, 24 / 255, 43 / 255);
const BLUE = new Color(33 / 255, 102 / 255, 172 / 255);
const WHITE = new Color(1, 1, 1);
const GROUND = "#f1efe9"; // --paper-sunken
const PLAIN = "#b9b4a8";
const TURN = Math.PI / 36; // radians for each press of an arrow key
const STEP = 0.9; // factor of the distance for each press of +
const FIELD_OF_VIEW = 35; // degrees
const UNITS = { mesh: "triangles", cloud: "points", splat: "splats" };
/** @type {Partial<Record<string, [number, number]>>} to the right and down */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** @type {Partial<Record<string, number>>} factors of the distance */
const ZOOMS = { "+": STEP, "=": STEP, "-": 1 / STEP };

/** @param {string} name */
function select(name) {
  return required(HTMLSelectElement, `[name=${name}]`);
}

/** A canvas with its camera and the model in it. */
class View {
  /** @param {Element} figure */
  constructor(figure) {
    this.figure = figure;
    this.canvas = required(HTMLCanvasElement, "canvas", figure);
    this.facts = required(HTMLElement, "[data-facts]", figure);
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.scene = new Scene();
    this.scene.background = new Color(GROUND);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 1, 1e6);
    const lamp = new DirectionalLight("#ffffff", 2.4);
    this.camera.add(lamp);
    this.scene.add(this.camera, new AmbientLight("#ffffff", 0.9));
    this.controls = new OrbitControls(this.camera, this.canvas);
    /** @type {Mesh<BufferGeometry, Material> | Points<BufferGeometry, Material> | SplatMesh | null} */
    this.object = null;
    /** @type {Sphere | null} around the object */
    this.around = null;
    /** @type {SparkRenderer | null} what draws splats, once there were any */
    this.spark = null;
    this.isRequested = false; // to be drawn at the next animation frame
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
    if (this.isRequested) return;
    this.isRequested = true;
    requestAnimationFrame(() => {
      this.isRequested = false;
      const { clientWidth, clientHeight } = this.canvas;
      this.renderer.setSize(clientWidth, clientHeight, false);
      this.camera.aspect = clientWidth / clientHeight;
      this.camera.updateProjectionMatrix();
      this.renderer.render(this.scene, this.camera);
    });
  }

  /** @param {Model | undefined} model */
  async show(model) {
    this.wanted = model?.url;
    this.facts.textContent = model ? "" : "no such model";
    this.put(null);
    this.figure.classList.toggle("is-loading", Boolean(model));
    if (!model) return;
    try {
      const shown = model.kind === "splat" ? await this.splats(model.url) : await read(model.url);
      if (this.wanted !== model.url) return; // another model was chosen meanwhile
      this.put(shown);
      const limit = model.error_limit_mm;
      const n = model.kind === "mesh" ? model.n_faces : model.n_points;
      const near = limit === null ? "" : `, 95 % within ${limit.toFixed(1)} mm`;
      this.facts.textContent = `${n.toLocaleString("en")} ${UNITS[model.kind]}${near}`;
      this.canvas.setAttribute("aria-label", `${model.kind} of ${model.dataset} by ${model.condition}`);
    } catch {
      if (this.wanted === model.url) this.facts.textContent = "could not be loaded; choose it again later";
    } finally {
      if (this.wanted === model.url) this.figure.classList.remove("is-loading");
    }
  }

  /** Fetches splats, and what draws them. @param {string} url */
  async splats(url) {
    const { SparkRenderer, SplatFileType, SplatMesh } = await import("/static/vendor/spark.js");
    if (!this.spark) {
      this.spark = new SparkRenderer({ renderer: this.renderer, onDirty: () => this.draw() });
      this.scene.add(this.spark);
    }
    return new SplatMesh({ url, fileType: SplatFileType.PLY }).initialized;
  }

  /** Puts a model in place of the present one. @param {BufferGeometry | SplatMesh | null} shown */
  put(shown) {
    if (this.object) {
      this.scene.remove(this.object);
      if (isSplats(this.object)) this.object.dispose();
      else this.object.material.dispose();
    }
    if (!shown) this.object = null;
    else if (isSplats(shown)) this.object = shown;
    else this.object = shown.index ? new Mesh(shown) : new Points(shown);
    if (shown) this.around = isSplats(shown) ? shown.getBoundingBox(true).getBoundingSphere(new Sphere()) : shown.boundingSphere;
    if (this.object) this.scene.add(this.object);
    this.paint();
  }

  paint() {
    if (!this.object || isSplats(this.object)) return this.draw();
    const { geometry } = this.object;
    const wanted = controls.colours.value;
    const values = wanted === "error" ? errorColours(geometry) : geometry.userData.recordedColours;
    const hasColours = wanted !== "shape" && Boolean(values);
    if (hasColours) geometry.setAttribute("color", values);
    const options = { vertexColors: hasColours, color: hasColours ? "#ffffff" : PLAIN };
    this.object.material.dispose();
    if (!geometry.index) this.object.material = new PointsMaterial({ ...options, size: 2, sizeAttenuation: false });
    else if (wanted === "own" && hasColours) this.object.material = new MeshBasicMaterial({ ...options, side: DoubleSide });
    else this.object.material = new MeshLambertMaterial({ ...options, side: DoubleSide });
    this.draw();
  }

  /** Looks at the middle of the model from the front. */
  reset() {
    const sphere = this.object ? this.around : other(this).around;
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

/** @param {object} shown @returns {shown is SplatMesh} */
const isSplats = (shown) => "packedSplats" in shown;

/** @type {Map<string, Promise<BufferGeometry>>} */
const geometries = new Map();

/** Fetches a model's geometry; what came once is kept. @param {string} url */
function read(url) {
  let geometry = geometries.get(url);
  if (!geometry) {
    const loader = new PLYLoader();
    loader.setCustomPropertyNameMapping({ error: ["error"] });
    geometry = loader.loadAsync(url).then(prepare);
    geometry.catch(() => geometries.delete(url));
    geometries.set(url, geometry);
  }
  return geometry;
}

/** @param {BufferGeometry} geometry */
function prepare(geometry) {
  if (geometry.index && !geometry.getAttribute("normal")) geometry.computeVertexNormals();
  geometry.computeBoundingSphere();
  geometry.userData.recordedColours = geometry.getAttribute("color");
  return geometry;
}

/** Blue inside the truth, white on it, red outside. @param {BufferGeometry} geometry */
function errorColours(geometry) {
  const errors = geometry.getAttribute("error");
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

/** The error that has the full colour: with the slider in its middle, the larger of both models' 95 %. */
function limitMm() {
  const limits = chosen().map((model) => model?.error_limit_mm ?? 0);
  const middle = Math.max(...limits) || 1;
  return middle * 10 ** ((Number(controls.limit.value) - 50) / 50);
}

/** The models to choose from, of the chosen dataset and kind. */
function offered() {
  const isCloud = controls.kind.value === "cloud";
  return models.filter(({ dataset, kind }) => dataset === controls.dataset.value && (kind === "cloud") === isCloud);
}

function chosen() {
  return conditions.map(({ value }) => offered().find(({ condition }) => condition === value));
}

/** @param {View} view */
const other = (view) => (view === views[0] ? views[1] : views[0]);

/** Lets the other camera stand where this one does. @param {View} moved */
function link(moved) {
  if (!controls.linked.checked) return;
  const follower = other(moved);
  const { camera } = follower;
  const { target } = follower.controls;
  if (camera.position.equals(moved.camera.position) && target.equals(moved.controls.target)) return;
  camera.position.copy(moved.camera.position);
  camera.quaternion.copy(moved.camera.quaternion);
  camera.near = moved.camera.near;
  camera.far = moved.camera.far;
  target.copy(moved.controls.target);
  follower.draw();
}

/** @param {View} view @param {KeyboardEvent} event */
function onKey(view, event) {
  const arrow = ARROWS[event.key];
  const zoom = ZOOMS[event.key];
  if (!arrow && !zoom && event.key !== "Home") return;
  const [across, along] = arrow ?? [0, 0];
  event.preventDefault();
  const { camera, controls } = view;
  if (event.key === "Home") view.reset();
  else if (event.shiftKey && !zoom) move(view, across, along);
  else turn(camera, controls.target, TURN * across, TURN * along, zoom ?? 1);
  controls.update();
  link(view);
  view.draw();
}

/**
 * Turns a camera about its target, and changes its distance.
 * @param {Camera} camera
 * @param {Vector3} target
 * @param {number} across radians
 * @param {number} along radians
 * @param {number} zoom factor of the distance
 */
function turn(camera, target, across, along, zoom) {
  const apart = camera.position.clone().sub(target);
  const side = new Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
  apart.applyAxisAngle(camera.up, across);
  const raised = apart.clone().applyAxisAngle(side, along);
  if (raised.angleTo(camera.up) > TURN && raised.angleTo(camera.up) < Math.PI - TURN) apart.copy(raised);
  camera.position.copy(target).add(apart.multiplyScalar(zoom));
  camera.lookAt(target);
}

/** @param {View} view @param {number} across steps to the right @param {number} along steps down */
function move({ camera, controls }, across, along) {
  const length = camera.position.distanceTo(controls.target) / 20;
  const step = new Vector3(length * across, -length * along, 0).applyQuaternion(camera.quaternion);
  camera.position.add(step);
  controls.target.add(step);
}

/** @param {string} reason */
function tell(reason) {
  const fault = byId("models-fault");
  fault.textContent = reason;
  fault.hidden = false;
}

function fillConditions() {
  const names = offered().map((model) => model.condition);
  conditions.forEach((field, side) => {
    const before = field.value;
    field.replaceChildren(...names.map((name) => new Option(name)));
    field.value = names.includes(before) ? before : (names[side] ?? names[0] ?? "");
  });
}

async function showChosen({ isOtherScene = false } = {}) {
  tellScale();
  await Promise.all(chosen().map((model, side) => views[side].show(model)));
  if (isOtherScene) views.forEach((view) => view.reset());
}

function tellScale() {
  const known = chosen().some((model) => model?.error_limit_mm != null);
  const { colours } = controls;
  required(HTMLOptionElement, "[value=error]", colours).disabled = !known;
  if (!known && colours.value === "error") colours.value = "own";
  byId("errors-scale").hidden = colours.value !== "error";
  const limit = limitMm();
  controls.limitMm.value = `± ${limit < 100 ? limit.toPrecision(2) : Math.round(limit)} mm`;
  controls.limit.setAttribute("aria-valuetext", controls.limitMm.value);
}

function start() {
  const kinds = new Set(models.map(({ kind }) => (kind === "cloud" ? "cloud" : "surface")));
  for (const option of controls.kind.options) option.disabled = !kinds.has(/** @type {"cloud" | "surface"} */ (option.value));
  controls.kind.value = kinds.has("surface") ? "surface" : "cloud";
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", (event) => {
    event.preventDefault(); // the choices stay
    views.forEach((view) => view.reset());
  });
  document.addEventListener("input", ({ target }) => {
    if (!(target instanceof HTMLInputElement || target instanceof HTMLSelectElement) || target.form !== form) return;
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
  for (const element of [form, byId("models"), byId("models-keys")]) element.hidden = true;
  tell("This browser shows no 3D (WebGL 2 is missing or switched off). The models can be downloaded below.");
}
