// Packs files into a tar archive (POSIX pax), as POST /v1/artefacts takes it.

const BLOCK = 512;
const encoder = new TextEncoder();

function put(header, offset, text) {
  header.set(encoder.encode(text), offset);
}

function octal(value, digits) {
  return `${value.toString(8).padStart(digits, "0")}\0`;
}

// The header of an entry; its name must fit, which those of pax entries do.
function headerOf(path, size, type) {
  const header = new Uint8Array(BLOCK);
  header.set(encoder.encode(path).subarray(0, 100), 0);
  // A browser does not tell which files are programs: all may be run.
  put(header, 100, octal(0o755, 7));
  put(header, 108, octal(0, 7));
  put(header, 116, octal(0, 7));
  put(header, 124, octal(Math.min(size, 0o77777777777), 11));
  put(header, 136, octal(0, 11));
  put(header, 148, "        ");
  put(header, 156, type);
  put(header, 257, "ustar\0" + "00");
  const sum = header.reduce((all, byte) => all + byte, 0);
  put(header, 148, `${sum.toString(8).padStart(6, "0")}\0 `);
  return header;
}

function padding(size) {
  return new Uint8Array((BLOCK - size % BLOCK) % BLOCK);
}

// A record of a pax header begins with its own length.
function paxRecord(key, value) {
  const rest = encoder.encode(` ${key}=${value}\n`).length;
  let length = rest + 1;
  while (String(length).length + rest !== length) length = String(length).length + rest;
  return `${length} ${key}=${value}\n`;
}

// A Blob of the archive. `files`: {path, file}, where file is a Blob; in any order.
export function pack(files) {
  const parts = [];
  for (const {path, file} of [...files].sort((a, b) => (a.path < b.path ? -1 : 1))) {
    const pax = encoder.encode(paxRecord("path", path) + paxRecord("size", file.size));
    parts.push(headerOf("pax", pax.length, "x"), pax, padding(pax.length),
      headerOf(path, file.size, "0"), file, padding(file.size));
  }
  parts.push(new Uint8Array(2 * BLOCK));
  return new Blob(parts, {type: "application/x-tar"});
}
