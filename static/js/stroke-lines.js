// Strokes as lines of points in pixels of a picture: add to them, erase from them.

/**
 * @typedef {[number, number]} Point column and row
 * @typedef {object} Stroke
 * @property {"foreground" | "background"} label
 * @property {Point[]} points
 * @property {number} width pixels
 */

const NEAR = 2; // pixels between points: nearer ones tell nothing more

/**
 * Adds a point to a line, unless it is almost where the last one is.
 * @param {Point[]} points
 * @param {Point} point
 * @returns {Point[]}
 */
export function extended(points, point) {
  const last = points.at(-1);
  return last && distance(last, point) < NEAR ? points : [...points, point];
}

/**
 * Takes away what lies under a round eraser that moves; a line that it cuts falls into pieces.
 * @param {readonly Stroke[]} strokes
 * @param {Point} from
 * @param {Point} to
 * @param {number} radius pixels
 * @returns {Stroke[]} the same strokes where it touches none
 */
export function erased(strokes, from, to, radius) {
  return strokes.flatMap((stroke) => {
    const reach = radius + stroke.width / 2;
    const way = refined([from, to], reach / 2);
    const line = refined(stroke.points, reach / 2);
    const isKept = (/** @type {Point} */ point) => way.every((at) => distance(point, at) > reach);
    return line.every(isKept) ? [stroke] : pieces(line, isKept).map((points) => ({ ...stroke, points }));
  });
}

/**
 * Puts points between those that are further apart than a step.
 * @param {readonly Point[]} points
 * @param {number} step pixels
 * @returns {Point[]}
 */
function refined(points, step) {
  return points.flatMap((point, index) => {
    const next = points[index + 1];
    const n = next ? Math.max(1, Math.ceil(distance(point, next) / step)) : 1;
    return Array.from({ length: n }, (_, part) => {
      const share = part / n;
      return /** @type {Point} */ (next && part ? point.map((value, axis) => Math.round(value + share * (next[axis] - value))) : point);
    });
  });
}

/**
 * @param {readonly Point[]} points
 * @param {(point: Point) => boolean} isKept
 * @returns {Point[][]} the runs of kept points
 */
function pieces(points, isKept) {
  /** @type {Point[][]} */
  const runs = [];
  let isOpen = false;
  for (const point of points) {
    if (!isKept(point)) isOpen = false;
    else if (isOpen) runs[runs.length - 1].push(point);
    else {
      runs.push([point]);
      isOpen = true;
    }
  }
  return runs;
}

/** @param {Point} a @param {Point} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
