import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { createHash } from "node:crypto";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, test } from "node:test";

import { readTrack } from "../../../static/js/mp4.js";

const FFMPEG = execFileSync("python", ["-c", "import imageio_ffmpeg; print(imageio_ffmpeg.get_ffmpeg_exe())"], { encoding: "utf8" }).trim();
const WIDTH = 64;
const HEIGHT = 48;
const N_PICTURES = 30;
const SERVER = "-bf 0 -g 12 -movflags +faststart"; // as the server makes films of one stimulus

const folder = mkdtempSync(join(tmpdir(), "films-"));
after(() => rmSync(folder, { recursive: true }));

let n_films = 0;
function encode(options, sound = "") {
  const path = join(folder, `${(n_films += 1)}.mp4`);
  const source = `-f lavfi -i testsrc2=size=${WIDTH}x${HEIGHT}:rate=25 ${sound}`;
  const codec = `-frames:v ${N_PICTURES} -c:v libx264 -profile:v high -level 4.0 -pix_fmt yuv420p`;
  execFileSync(FFMPEG, ["-v", "error", ...`${source} ${codec} ${options}`.split(/ +/), path]);
  return path;
}

/** What ffmpeg finds in a file: the digest of each picture, and whether it needs no other. */
function packets(path) {
  const list = (format) => {
    const text = execFileSync(FFMPEG, ["-v", "error", "-i", path, "-map", "0:v", "-c", "copy", "-f", format, "-"], { encoding: "utf8" });
    return text.trim().split("\n").filter((line) => !line.startsWith("#"));
  };
  const digests = list("framemd5").map((line) => line.split(",").at(-1).trim());
  const keys = list("framecrc").map((line) => !line.includes("F=")); // flags are listed for all but key pictures
  return digests.map((digest, number) => ({ digest, isKey: keys[number] }));
}

/** A file's bytes in a buffer of their own, as a Blob gives them. */
const bytesOf = (path) => new Uint8Array(readFileSync(path));
const found = ({ pictures }) => pictures.map(({ data, isKey }) => ({ digest: createHash("md5").update(data).digest("hex"), isKey }));

for (const [name, options, sound] of [
  ["a film as the server makes it", SERVER],
  ["a film whose table is at its end", "-bf 0 -g 12"],
  ["a film of key pictures only, which has no table of them", "-bf 0 -g 1"],
  ["a film in chunks of unequal length, with sound between", `${SERVER} -shortest -chunk_duration 100000`, "-f lavfi -i sine"],
]) {
  test(`the pictures of ${name} are those that ffmpeg finds`, () => {
    const path = encode(options, sound);
    const track = readTrack(bytesOf(path).buffer);
    assert.equal(track.pictures.length, N_PICTURES);
    assert.deepEqual(found(track), packets(path));
  });
}

test("a film tells its size, its codec and the decoder's set-up", () => {
  const track = readTrack(bytesOf(encode(SERVER)).buffer);
  assert.deepEqual([track.width, track.height, track.codec], [WIDTH, HEIGHT, "avc1.640028"]); // high profile, level 4.0
  assert.deepEqual([...track.description.slice(0, 4)], [1, 0x64, 0, 0x28]); // ISO/IEC 14496-15, 5.3.3.1
});

test("a film in another order than it is shown in is refused", () => {
  assert.throws(() => readTrack(bytesOf(encode("-bf 2 -g 12")).buffer), /not in the order/);
});

test("a film without an H.264 track is refused by the box that it lacks", () => {
  assert.throws(() => readTrack(bytesOf(encode("-c:v mpeg4 -profile:v 0 -level 3")).buffer), /no box avc1/);
  assert.throws(() => readTrack(new ArrayBuffer(0)), /no box moov/);
});

test("a film that breaks off anywhere is refused", () => {
  const whole = bytesOf(encode(SERVER));
  for (let length = 0; length < whole.length; length += 1) assert.throws(() => readTrack(whole.slice(0, length).buffer), `${length} bytes`);
  assert.throws(() => readTrack(whole.slice(0, 100).buffer), /breaks off in its box at byte 32$/);
});

const CONTAINERS = ["moov", "trak", "mdia", "minf", "stbl"];

/** The boxes of an MP4 (ISO/IEC 14496-12, 4.2) written anew, each that `write` knows by what it makes of the content. */
function rewrite(bytes, write) {
  const boxes = [];
  for (let at = 0; at < bytes.length; ) {
    const size = bytes.readUInt32BE(at);
    const name = bytes.toString("latin1", at + 4, at + 8);
    const content = bytes.subarray(at + 8, at + size);
    if (CONTAINERS.includes(name)) boxes.push(box(name, rewrite(content, write)));
    else boxes.push(write[name]?.(content) ?? box(name, content));
    at += size;
  }
  return Buffer.concat(boxes);
}

function box(name, content) {
  const header = Buffer.alloc(8, `    ${name}`, "latin1");
  header.writeUInt32BE(8 + content.length);
  return Buffer.concat([header, content]);
}

test("places and lengths in 64 bits are read as those in 32", () => {
  const bytes = readFileSync(encode("-bf 0 -g 12 -shortest -chunk_duration 100000", "-f lavfi -i sine"));
  const changed = rewrite(bytes, { // its table is at its end, so nothing before it moves
    stco: (content) => {
      const n_chunks = content.readUInt32BE(4);
      const places = Array.from({ length: n_chunks }, (_, chunk) => content.subarray(8 + 4 * chunk, 12 + 4 * chunk));
      return box("co64", Buffer.concat([content.subarray(0, 8), ...places.flatMap((place) => [Buffer.alloc(4), place])]));
    },
    stsz: (content) => {
      const header = Buffer.alloc(16, "\0\0\0\x01stsz", "latin1");
      header.writeBigUInt64BE(BigInt(16 + content.length), 8);
      return Buffer.concat([header, content]);
    },
  });
  assert.notDeepEqual(changed, bytes);
  assert.deepEqual(found(readTrack(new Uint8Array(changed).buffer)), found(readTrack(new Uint8Array(bytes).buffer)));
});
