// Packs files into a zip archive without compressing them: films are compressed already. Their bytes stay where they are;
// each is read once, for its checksum.

const LARGEST = 0xffffffff; // of an archive without the extensions for larger ones
const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; bit += 1) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

/**
 * @param {{ name: string, file: Blob }[]} entries
 * @param {(done: number) => void} tell the share of bytes that were read
 * @returns {Promise<Blob>}
 */
export async function packed(entries, tell) {
  const total = entries.reduce((sum, { file }) => sum + file.size, 0);
  if (total > LARGEST - 1e6) throw new Error("These films have more than 4 GB: pack them into a zip file yourself.");
  const [parts, directory] = [/** @type {BlobPart[]} */ ([]), /** @type {BlobPart[]} */ ([])];
  let [at, done] = [0, 0];
  for (const { name, file } of entries) {
    const crc = await checksum(file, (n) => tell((done += n) / total));
    const bytes = new TextEncoder().encode(name);
    const common = [[2, 20], [2, 0x800], [2, 0], [2, 0], [2, 0x21], [4, crc], [4, file.size], [4, file.size], [2, bytes.length], [2, 0]];
    parts.push(numbers([[4, 0x04034b50], ...common]), bytes, file);
    directory.push(numbers([[4, 0x02014b50], [2, 20], ...common, [2, 0], [2, 0], [2, 0], [4, 0], [4, at]]), bytes);
    at += 30 + bytes.length + file.size;
  }
  const size = directory.reduce((sum, part) => sum + /** @type {Uint8Array} */ (part).length, 0);
  const n = entries.length;
  const end = numbers([[4, 0x06054b50], [2, 0], [2, 0], [2, n], [2, n], [4, size], [4, at], [2, 0]]);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}

/** @param {number[][]} fields size in bytes and value of each, the lowest byte first @returns {Uint8Array<ArrayBuffer>} */
function numbers(fields) {
  return Uint8Array.from(fields.flatMap(([n, value]) => Array.from({ length: n }, (_, i) => (value >>> (8 * i)) & 0xff)));
}

/** @param {Blob} file @param {(n: number) => void} tell @returns {Promise<number>} */
async function checksum(file, tell) {
  let crc = 0xffffffff;
  const reader = file.stream().getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return (crc ^ 0xffffffff) >>> 0;
    for (const byte of value) crc = CRC[(crc ^ byte) & 0xff] ^ (crc >>> 8);
    tell(value.length);
  }
}
