// Copies what browsers load from node_modules into a folder: node vendor.mjs OUT
// Bare names of modules become paths, because an import map would have to stand inline, which the content policy forbids.
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const modules = join(dirname(fileURLToPath(import.meta.url)), "node_modules");
const out = process.argv[2];

const COPIED = {
  "htmx.min.js": "htmx.org/dist/htmx.min.js",
  "htmx.LICENSE": "htmx.org/LICENSE",
  "sse.min.js": "htmx-ext-sse/dist/sse.min.js",
  "sse.LICENSE": "htmx-ext-sse/LICENSE",
  "vega.min.js": "vega/build/vega.min.js",
  "vega.LICENSE": "vega/LICENSE",
  "three.core.min.js": "three/build/three.core.min.js",
  "three.module.min.js": "three/build/three.module.min.js",
  "three.LICENSE": "three/LICENSE",
  "spark.LICENSE": "@sparkjsdev/spark/LICENSE",
};

// The interpreter takes from vega's own bundle what it would take from a package of it.
const INTERPRETER = [/^import (\{[^}]*\}) from 'vega-util';/m, "const $1 = globalThis.vega;"];
const THREE = [/from 'three'/g, 'from "./three.module.min.js"'];
const SPARK = [/from "three"/g, 'from "./three.module.min.js"'];
const PASS = [/from "three\/addons\/postprocessing\/Pass\.js"/g, 'from "./Pass.js"'];
const UTILS = [/from '\.\.\/utils\/BufferGeometryUtils\.js'/g, 'from "./BufferGeometryUtils.js"'];

const REWRITTEN = {
  "vega-interpreter.js": ["vega-interpreter/build/vega-interpreter.js", INTERPRETER],
  "OrbitControls.js": ["three/examples/jsm/controls/OrbitControls.js", THREE],
  "GLTFLoader.js": ["three/examples/jsm/loaders/GLTFLoader.js", THREE, UTILS],
  "PLYLoader.js": ["three/examples/jsm/loaders/PLYLoader.js", THREE],
  "Pass.js": ["three/examples/jsm/postprocessing/Pass.js", THREE],
  "spark.js": ["@sparkjsdev/spark/dist/spark.module.min.js", SPARK, PASS],
  "BufferGeometryUtils.js": ["three/examples/jsm/utils/BufferGeometryUtils.js", THREE],
};

mkdirSync(out, { recursive: true });
for (const [name, source] of Object.entries(COPIED)) copyFileSync(join(modules, source), join(out, name));
for (const [name, [source, ...rewrites]] of Object.entries(REWRITTEN)) {
  let text = readFileSync(join(modules, source), "utf8");
  for (const [from, to] of rewrites) {
    const rewritten = text.replace(from, to);
    if (rewritten === text) throw new Error(`${source}: has no ${from}; the package has changed`);
    text = rewritten;
  }
  writeFileSync(join(out, name), text);
}
