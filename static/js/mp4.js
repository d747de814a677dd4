/**
 * Reads the pictures of a film of one stimulus: MP4 as the server makes it, one H.264 track whose pictures lie in the
 * order in which they are shown.
 *
 * No library: the server makes all films alike and anything else is refused. mp4box (2.4) would be 330 kB and
 * mediabunny (1.61) 690 kB of script beside the 110 kB of everything else that a participant's browser loads, and the
 * participant's pages need no other package.
 */

/**
 * @typedef {object} Track
 * @property {string} codec for a VideoDecoder
 * @property {Uint8Array<ArrayBuffer>} description of the decoder's set-up: the avcC box
 * @property {number} width pixels
 * @property {number} height pixels
 * @property {{data: Uint8Array<ArrayBuffer>, isKey: boolean}[]} pictures compressed, in order
 */

const VISUAL_SAMPLE_ENTRY = 78; // bytes before its boxes, ISO/IEC 14496-12, 12.1.3
const WIDTH_AT = 24; // in a sample entry

/** @param {ArrayBuffer} file @returns {Track} */
export function readTrack(file) {
  const media = inside(inside(inside(whole(file), "moov"), "trak"), "mdia");
  const table = inside(inside(media, "minf"), "stbl");
  const entry = inside(skip(inside(table, "stsd"), 8), "avc1");
  const description = bytes(inside(skip(entry, VISUAL_SAMPLE_ENTRY), "avcC"));
  if (find(table, "ctts")) throw new Error("the film's pictures are not in the order in which they are shown");
  const keys = keyNumbers(find(table, "stss"));
  return {
    codec: `avc1.${hex(description[1])}${hex(description[2])}${hex(description[3])}`,
    description,
    width: entry.getUint16(WIDTH_AT),
    height: entry.getUint16(WIDTH_AT + 2),
    pictures: places(table).map(([start, size], number) => ({
      data: new Uint8Array(file, start, size),
      isKey: keys === null || keys.has(number),
    })),
  };
}

/** Where each picture lies: chunk by chunk, one after the other within a chunk. @param {DataView} table @returns {[number, number][]} start and size, bytes */
function places(table) {
  const sizes = pictureSizes(inside(table, "stsz"));
  const chunks = chunkStarts(table);
  const runs = inside(table, "stsc"); // each run: its first chunk, counted from 1, and how many pictures each chunk has
  const n_runs = runs.getUint32(4);
  /** @type {[number, number][]} */
  const placed = [];
  for (let run = 0; run < n_runs; run += 1) {
    const first = runs.getUint32(8 + 12 * run) - 1;
    const after = run + 1 < n_runs ? runs.getUint32(8 + 12 * (run + 1)) - 1 : chunks.length;
    const n_pictures = runs.getUint32(12 + 12 * run);
    for (const start of chunks.slice(first, after)) {
      let at = start;
      for (let picture = 0; picture < n_pictures; picture += 1) {
        const size = sizes[placed.length];
        placed.push([at, size]);
        at += size;
      }
    }
  }
  if (placed.length !== sizes.length) throw new Error(`the film has ${placed.length} pictures in its chunks, expected ${sizes.length}`);
  return placed;
}

/** @param {DataView} table @returns {number[]} bytes */
function chunkStarts(table) {
  const small = find(table, "stco");
  if (small) return numbers(small.getUint32(4), (index) => small.getUint32(8 + 4 * index));
  const large = inside(table, "co64");
  return numbers(large.getUint32(4), (index) => Number(large.getBigUint64(8 + 8 * index)));
}

/** @param {DataView} box @returns {number[]} bytes */
function pictureSizes(box) {
  const common = box.getUint32(4); // 0: sizes differ and follow
  return numbers(box.getUint32(8), (index) => common || box.getUint32(12 + 4 * index));
}

/** Pictures that can be decoded without any other. @param {DataView | null} box @returns {Set<number> | null} counted from 0; null: all */
function keyNumbers(box) {
  return box && new Set(numbers(box.getUint32(4), (index) => box.getUint32(8 + 4 * index) - 1));
}

/** @param {number} count @param {(index: number) => number} read */
function numbers(count, read) {
  return Array.from({ length: count }, (_, index) => read(index));
}

/** The content of a box that must be there. @param {DataView} parent @param {string} name @returns {DataView} */
function inside(parent, name) {
  const box = find(parent, name);
  if (!box) throw new Error(`the film has no box ${name}`);
  return box;
}

/** @param {DataView} parent @param {string} name @returns {DataView | null} */
function find(parent, name) {
  for (let at = 0; at + 8 <= parent.byteLength; ) {
    const size = parent.getUint32(at);
    const isLong = size === 1; // its size follows in 64 bits
    const length = isLong ? Number(parent.getBigUint64(at + 8)) : size || parent.byteLength - at;
    if (length < 8 || at + length > parent.byteLength) throw new Error(`the film breaks off in its box at byte ${at}`);
    const header = isLong ? 16 : 8;
    if (nameAt(parent, at + 4) === name) return new DataView(parent.buffer, parent.byteOffset + at + header, length - header);
    at += length;
  }
  return null;
}

/** @param {DataView} view @param {number} at */
function nameAt(view, at) {
  return String.fromCharCode(...new Uint8Array(view.buffer, view.byteOffset + at, 4));
}

/** @param {ArrayBuffer} file */
function whole(file) {
  return new DataView(file);
}

/** @param {DataView} view @param {number} count bytes */
function skip(view, count) {
  return new DataView(view.buffer, view.byteOffset + count, view.byteLength - count);
}

/** @param {DataView} view @returns {Uint8Array<ArrayBuffer>} */
function bytes(view) {
  return new Uint8Array(/** @type {ArrayBuffer} */ (view.buffer), view.byteOffset, view.byteLength);
}

/** @param {number} byte */
function hex(byte) {
  return byte.toString(16).padStart(2, "0");
}
