// Trajectory files (sim/trajectory/README.md), read whole and checked. Nothing here knows a page.

const MAGIC = "MYOTRAJ1";
const HEAD_AT = 12;
const MOST_HEAD = 1 << 20;
export const MOST_BYTES = 64 << 20;
const MOST = {frames: 20001, bodies: 1000, muscles: 1000, wraps: 1000, series: 64, events: 10000,
  side: 4096, contacts: 12, text: 500};
const BYTES = {u8: 1, u16: 2};

// Why a file can't be shown, in a sentence.
export class FileError extends Error {}

function check(fits, words) {
  if (!fits) throw new FileError(`The replay's file is damaged: ${words}.`);
}

function text(value, what) {
  check(typeof value === "string" && value.length <= MOST.text, `${what} is not text`);
  return value;
}

function finite(value, what) {
  check(Number.isFinite(value), `${what} is not a number`);
  return value;
}

function whole(value, most, what) {
  check(Number.isInteger(value) && value >= 0 && value <= most,
    `${what} is not a whole number from 0 to ${most}`);
  return value;
}

function list(value, most, what) {
  check(Array.isArray(value) && value.length <= most, `${what} is not a list of at most ${most}`);
  return value;
}

function object(value, what) {
  check(value !== null && typeof value === "object" && !Array.isArray(value),
    `${what} is not a JSON object`);
  return value;
}

function vector(value, size, what) {
  check(list(value, size, what).length === size, `${what} has not ${size} numbers`);
  return value.map((one) => finite(one, what));
}

function readHead(bytes) {
  check(bytes.length >= HEAD_AT && MAGIC === String.fromCharCode(...bytes.subarray(0, 8)),
    `it does not begin with ${MAGIC}`);
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(8, true);
  check(length <= MOST_HEAD && HEAD_AT + length <= bytes.length, "its head is cut off or too long");
  let head;
  try {
    head = JSON.parse(new TextDecoder("utf-8", {fatal: true})
      .decode(bytes.subarray(HEAD_AT, HEAD_AT + length)));
  } catch {
    check(false, "its head is no JSON");
  }
  object(head, "its head");
  if (head.format !== 1) {
    throw new FileError(`The replay's file has format ${String(head.format).slice(0, 20)}, and this `
      + "page reads format 1: reload the page.");
  }
  return {head, rest: bytes.subarray(HEAD_AT + length)};
}

function readBodies(head) {
  return list(head.bodies, MOST.bodies, "bodies").map((body, place) => {
    object(body, "a body");
    return {name: text(body.name, "a body's name"),
      from: body.from === undefined ? null : whole(body.from, place - 1, "a body's \"from\""),
      scale: body.scale === undefined ? null : vector(body.scale, 3, "a body's scale"),
      target: body.target === true};
  });
}

function readSeries(head) {
  return list(head.series, MOST.series, "series").map((one) => {
    object(one, "a series");
    return {name: text(one.name, "a series' name"), title: text(one.title, "a series' title"),
      unit: text(one.unit, "a series' unit"),
      graph: one.graph === undefined ? null : text(one.graph, "a series' graph"),
      tolerance: one.tolerance === undefined ? 0 : Math.abs(finite(one.tolerance, "a series' tolerance")),
      labels: one.labels === undefined ? null : list(one.labels, 256, "a series' labels")
        .map((label) => text(label, "a series' label"))};
  });
}

function readEvents(head) {
  const events = list(head.events, MOST.events, "events").map((one) => {
    object(one, "an event");
    return {time: finite(one.time_s, "an event's time"), kind: text(one.kind, "an event's kind"),
      text: text(one.text, "an event's text"),
      value: one.value === undefined || one.value === null ? null
        : finite(one.value, "an event's value"),
      unit: one.unit === undefined || one.unit === null ? "" : text(one.unit, "an event's unit")};
  });
  return events.sort((a, b) => a.time - b.time);
}

function readTerrain(head) {
  if (head.terrain === null || head.terrain === undefined) return null;
  const terrain = object(head.terrain, "terrain");
  const made = {rows: whole(terrain.rows, MOST.side, "terrain.rows"),
    columns: whole(terrain.columns, MOST.side, "terrain.columns"),
    low: vector(terrain.low, 2, "terrain.low"), high: vector(terrain.high, 2, "terrain.high")};
  check(made.rows >= 2 && made.columns >= 2 && made.rows * made.columns <= 4e6,
    "its terrain has too few or too many points");
  return made;
}

// The whole numbers of an array, as they were before they were packed (README.md, Arrays).
function unpack(bytes, type, channels, length) {
  const count = channels * length;
  const numbers = type === "u8" ? new Uint8Array(count) : new Uint16Array(count);
  for (let channel = 0, at = 0; channel < channels; channel += 1) {
    for (let i = 0, value = 0; i < length; i += 1, at += 1) {
      const coded = type === "u8" ? bytes[at] : bytes[at] | bytes[count + at] << 8;
      value += coded & 1 ? -((coded + 1) >> 1) : coded >> 1;
      numbers[at] = value;
    }
  }
  return numbers;
}

// One number for all channels, or one for each.
function bounds(value, channels, what) {
  if (!Array.isArray(value)) return () => value;
  if (value.length === 1) return () => finite(value[0], what);
  vector(value, channels, what);
  return (channel) => value[channel];
}

// An array, checked against what it must be: `raw` holds the whole numbers, channel after channel;
// `low` and `high` tell for a channel what 0 and the most stand for.
function readArray(head, rest, name, type, channels, length) {
  const known = object(object(head.arrays, "arrays")[name], `the array "${name}"`);
  const what = `the array "${name}"`;
  check(known.type === type && known.channels === channels && known.length === length,
    `${what} is not of type ${type} with ${channels} times ${length} numbers`);
  const bytes = channels * length * BYTES[type];
  check(known.bytes === bytes, `${what} has not ${bytes} bytes`);
  whole(known.offset, MOST_BYTES, `the offset of ${what}`);
  check(known.offset + bytes <= rest.length, `${what} is cut off`);
  if (!bytes) return {raw: new Uint8Array(0), low: () => 0, high: () => 0};
  const low = bounds(known.low, channels, what);
  const high = bounds(known.high, channels, what);
  for (let channel = 0; channel < channels; channel += 1) {
    finite(low(channel), what);
    finite(high(channel), what);
  }
  return {raw: unpack(rest.subarray(known.offset, known.offset + bytes), type, channels, length), low,
    high};
}

// The values of an array with the channels of a frame beside each other.
function values(head, rest, name, type, channels, length) {
  const {raw, low, high} = readArray(head, rest, name, type, channels, length);
  const most = type === "u8" ? 255 : 65535;
  const made = new Float32Array(raw.length);
  for (let channel = 0; channel < channels; channel += 1) {
    const base = low(channel);
    const step = (high(channel) - base) / most;
    for (let i = 0; i < length; i += 1) {
      made[i * channels + channel] = base + step * raw[channel * length + i];
    }
  }
  return made;
}

function readPositions(head, rest, bodies, frames) {
  const made = values(head, rest, "position", "u16", 3 * bodies.length, frames);
  for (let frame = 0; frame < frames; frame += 1) {
    const at = frame * 3 * bodies.length;
    bodies.forEach((body, place) => {
      if (body.from === null) return;
      for (let axis = 0; axis < 3; axis += 1) {
        made[at + 3 * place + axis] += made[at + 3 * body.from + axis];
      }
    });
  }
  return made;
}

function readRotations(head, rest, bodies, frames) {
  const made = values(head, rest, "rotation", "u16", 4 * bodies.length, frames);
  for (let at = 0; at < made.length; at += 4) {
    const size = Math.hypot(made[at], made[at + 1], made[at + 2], made[at + 3]);
    if (size > 1e-6) for (let i = 0; i < 4; i += 1) made[at + i] /= size;
    else made.set([1, 0, 0, 0], at);
  }
  return made;
}

// Whether each wrap is there is the first of its seven numbers, and is 1 or 0.
function readWraps(head, rest, count, frames) {
  const made = values(head, rest, "wrap", "u8", 7 * count, frames);
  const {raw} = readArray(head, rest, "wrap", "u8", 7 * count, frames);
  for (let wrap = 0; wrap < count; wrap += 1) {
    for (let frame = 0; frame < frames; frame += 1) {
      made[(frame * count + wrap) * 7] = raw[7 * wrap * frames + frame] ? 1 : 0;
    }
  }
  return made;
}

function readContacts(head, rest, bodies, frames) {
  const {raw} = readArray(head, rest, "contact_count", "u8", 1, frames);
  const first = new Uint32Array(frames + 1);
  for (let frame = 0; frame < frames; frame += 1) {
    check(raw[frame] <= MOST.contacts, `a frame has more than ${MOST.contacts} contacts`);
    first[frame + 1] = first[frame] + raw[frame];
  }
  const count = first[frames];
  // Two for each: the body that the force is on, and the other; 0 is the world. Older files don't tell.
  const known = head.arrays.contact_body !== undefined;
  const touching = known ? readArray(head, rest, "contact_body", "u16", 2, count).raw : new Uint16Array(0);
  check(touching.every((one) => one <= bodies.length), "a contact is of a body that there is not");
  const nameOf = (place) => (place ? bodies[place - 1].name : "");
  return {first, values: values(head, rest, "contact", "u16", 6, count),
    bodiesOf: known ? (contact) => [touching[contact], touching[count + contact]].map(nameOf) : null};
}

function readGraphs(head, rest, series, frames) {
  const all = values(head, rest, "series", "u16", series.length, frames);
  return series.map((one, place) => {
    const own = new Float32Array(frames);
    for (let frame = 0; frame < frames; frame += 1) own[frame] = all[frame * series.length + place];
    return {...one, values: own};
  });
}

// The largest of the contact forces, in N.
function strongForce(contacts) {
  let most = 0;
  for (let at = 0; at < contacts.values.length; at += 6) {
    most = Math.max(most, Math.hypot(...contacts.values.subarray(at + 3, at + 6)));
  }
  return most;
}

// The episode that a file holds; positions in m, times in s, forces in N. Throws FileError.
export function readTrajectory(buffer) {
  check(buffer.byteLength <= MOST_BYTES, `it has more than ${MOST_BYTES} bytes`);
  const {head, rest} = readHead(new Uint8Array(buffer));
  const frames = whole(head.frames, MOST.frames, "frames");
  check(frames >= 1, "it has no frame");
  const period = finite(head.period_s, "period_s");
  const duration = finite(head.duration_s, "duration_s");
  check(period > 0 && duration >= 0 && duration <= frames * period + 1e-6,
    "its times don't fit each other");
  const bodies = readBodies(head);
  const muscles = list(head.muscles, MOST.muscles, "muscles").map((one) => text(one, "a muscle"));
  const wraps = whole(head.wraps, MOST.wraps, "wraps");
  const terrain = readTerrain(head);
  const contacts = readContacts(head, rest, bodies, frames);
  return {track: text(head.track, "track"), model: text(head.model, "model"),
    episode: head.episode === null || head.episode === undefined ? null
      : finite(head.episode, "episode"),
    end: text(head.end, "end"), steps: finite(head.steps, "steps"), duration, period, frames, bodies,
    muscles, wraps, events: readEvents(head),
    legend: head.legend === undefined ? "" : text(head.legend, "legend"),
    position: readPositions(head, rest, bodies, frames),
    rotation: readRotations(head, rest, bodies, frames),
    activation: values(head, rest, "activation", "u8", muscles.length, frames),
    wrap: readWraps(head, rest, wraps, frames), contacts, strongForce: strongForce(contacts),
    series: readGraphs(head, rest, readSeries(head), frames),
    terrain: terrain && {...terrain, heights: values(head, rest, "terrain", "u16", terrain.rows,
      terrain.columns)}};
}

// What a model file tells besides its shapes (README.md, The model file), checked.
export function readModelExtras(extras) {
  object(extras, "the model's description");
  if (extras.format !== 1) {
    throw new FileError("The model's file has a format that this page does not know: reload the page.");
  }
  const camera = object(extras.camera, "camera");
  return {track: text(extras.track, "track"), model: text(extras.model, "model"),
    camera: {body: camera.body === null ? null : text(camera.body, "the camera's body"),
      lookAt: vector(camera.look_at, 3, "look_at"), distance: finite(camera.distance_m, "distance_m"),
      azimuth: finite(camera.azimuth_deg, "azimuth_deg"),
      elevation: finite(camera.elevation_deg, "elevation_deg")},
    muscles: list(extras.muscles, MOST.muscles, "muscles").map((muscle) => ({
      name: text(object(muscle, "a muscle").name, "a muscle's name"),
      radius: finite(muscle.radius_m, "radius_m"),
      path: list(muscle.path, 200, "a muscle's path").map((point) => ({
        body: object(point, "a point").body === null ? null : text(point.body, "a point's body"),
        wrap: point.wrap === undefined ? null : whole(point.wrap, MOST.wraps, "wrap"),
        at: point.wrap === undefined ? vector(point.at, 3, "a point's place") : null})),
    })),
    floor: extras.floor === null || extras.floor === undefined ? null
      : {height: finite(object(extras.floor, "floor").height_m, "height_m"),
        square: finite(extras.floor.square_m, "square_m"),
        halfSize: vector(extras.floor.half_size_m, 2, "half_size_m")}};
}
