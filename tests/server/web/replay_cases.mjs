// How pages read answers, compare submissions, where signing in leads, which archives the form takes, and how the replay reads
// files, keeps time and finds poses. replay_test.py copies this beside the page's modules, with files that
// it made and what is in them.
import assert from "node:assert/strict";
import fs from "node:fs";
import test from "node:test";

import {parseJson} from "./api.js";
import {pairedDifference, pairsOf} from "./comparison.js";
import {briefly} from "./format.js";
import {Clock} from "./replay_clock.js";
import {eventWords, lasting} from "./replay_controls.js";
import {FileError, readModelExtras, readTrajectory} from "./replay_file.js";
import {valueAt} from "./replay_graphs.js";
import {courseOf, isCourse} from "./replay_map.js";
import {target} from "./sign_in.js";
import {parcelOf} from "./submit.js";
import {boundPaths, followedPath, frameAt, framesAt, mostSegments, pointAt, posesAt, segmentsAt}
  from "./replay_pose.js";

const bytes = new Uint8Array(fs.readFileSync("walk.bin"));
const truth = JSON.parse(fs.readFileSync("walk.json"));
const read = (data) => readTrajectory(data.slice().buffer);
const close = (a, b, most, what) => assert.ok(Math.abs(a - b) <= most, `${what}: ${a} is not ${b}`);

function parts(data = bytes) {
  const length = new DataView(data.buffer, data.byteOffset).getUint32(8, true);
  return {head: JSON.parse(new TextDecoder().decode(data.subarray(12, 12 + length))),
    rest: data.subarray(12 + length)};
}

function joined(text, rest) {
  const head = new TextEncoder().encode(text);
  const data = new Uint8Array(12 + head.length + rest.length);
  data.set(bytes.subarray(0, 8));
  new DataView(data.buffer).setUint32(8, head.length, true);
  data.set(head, 12);
  data.set(rest, 12 + head.length);
  return data;
}

// The file with its head changed.
function changed(change) {
  const {head, rest} = parts();
  change(head);
  return joined(JSON.stringify(head), rest);
}

test("numbers come out as they went in", () => {
  const made = read(bytes);
  assert.equal(made.frames, truth.frames);
  assert.deepEqual(made.bodies.map((body) => body.name), ["root", "arm"]);
  truth.samples.forEach(({frame, root, arm, turn, activation, distance, state, contacts}) => {
    for (let axis = 0; axis < 3; axis += 1) {
      close(made.position[6 * frame + axis], root[axis], 2e-3, `root at ${frame}`);
      close(made.position[6 * frame + 3 + axis], arm[axis], 2e-3, `arm at ${frame}`);
    }
    for (let i = 0; i < 4; i += 1) close(made.rotation[8 * frame + i], turn[i], 1e-4, "rotation");
    close(made.activation[2 * frame], activation, 1 / 254, "activation");
    close(made.series[0].values[frame], distance, 1e-3, "distance");
    assert.equal(made.series[2].values[frame], state);
    assert.equal(made.contacts.first[frame + 1] - made.contacts.first[frame], contacts);
  });
  close(made.terrain.heights[truth.terrain.column * made.terrain.rows + truth.terrain.row],
    truth.terrain.height, 1e-4, "terrain");
  close(made.strongForce, truth.strongest, 0.1, "a strong contact");
  assert.equal(made.events.at(-1).kind, "end");
});

test("a file that was cut off is refused in a sentence, wherever it was cut", () => {
  for (let length = 0; length < bytes.length; length += length < 3000 ? 13 : 997) {
    assert.throws(() => read(bytes.subarray(0, length)), FileError, `at ${length}`);
  }
});

test("damaged bytes give numbers or a sentence, and never another error", () => {
  let seed = 7;
  const random = (below) => {
    seed = (Math.imul(seed, 1103515245) + 12345) >>> 0;
    return (seed >>> 8) % below;
  };
  let refused = 0;
  for (let round = 0; round < 400; round += 1) {
    const data = bytes.slice();
    const most = round % 2 ? data.length : 1800;  // many within the head
    for (let i = 0; i < 1 + round % 4; i += 1) data[random(most)] = random(256);
    try {
      const made = read(data);
      for (const all of [made.position, made.rotation, made.contacts.values]) {
        assert.ok(all.every(Number.isFinite));
      }
    } catch (error) {
      assert.ok(error instanceof FileError, error.stack);
      assert.match(error.message, /^The replay's file .*[.:]/);
      refused += 1;
    }
  }
  assert.ok(refused > 50, `${refused} refused`);
});

test("heads that lie are refused", () => {
  const lies = {
    "many frames": (head) => { head.frames = 1e9; },
    "no frames": (head) => { head.frames = 0; },
    "frames that are text": (head) => { head.frames = "401"; },
    "more frames than there are": (head) => { head.frames += 1; },
    "a duration that doesn't end": (head) => { head.duration_s = 1e300; },
    "no period": (head) => { head.period_s = 0; },
    "a body that hangs on itself": (head) => { head.bodies[0].from = 0; },
    "a body that hangs on a later one": (head) => { head.bodies[0].from = 1; },
    "a body without a name": (head) => { head.bodies[0] = null; },
    "bodies that are none": (head) => { head.bodies = {length: 2}; },
    "a scale of text": (head) => { head.bodies[0].scale = ["1", 1, 1]; },
    "many muscles": (head) => { head.muscles = new Array(1e5).fill("x"); },
    "wraps below zero": (head) => { head.wraps = -1; },
    "a long text": (head) => { head.events[0].text = "x".repeat(1e5); },
    "an event without a time": (head) => { head.events[0].time_s = null; },
    "a terrain without end": (head) => { head.terrain.rows = 1e9; },
    "a terrain of a line": (head) => { head.terrain.rows = 1; },
    "an array that is missing": (head) => { delete head.arrays.rotation; },
    "an array elsewhere": (head) => { head.arrays.position.offset = 1e9; },
    "an array before the rest": (head) => { head.arrays.position.offset = -8; },
    "an array of half an offset": (head) => { head.arrays.position.offset = 0.5; },
    "an array of other bytes": (head) => { head.arrays.position.bytes -= 2; },
    "an array of other channels": (head) => { head.arrays.position.channels = 3; },
    "an array of another type": (head) => { head.arrays.position.type = "u8"; },
    "bounds that are missing": (head) => { delete head.arrays.position.low; },
    "bounds that are too few": (head) => { head.arrays.position.low = [0, 1]; },
    "bounds that are no numbers": (head) => { head.arrays.position.high[0] = {}; },
    "a series without a unit": (head) => { delete head.series[0].unit; },
    "labels that are no texts": (head) => { head.series[2].labels = [1]; },
  };
  for (const [what, change] of Object.entries(lies)) {
    assert.throws(() => read(changed(change)), FileError, what);
  }
  const {rest} = parts();
  for (const text of ["", "[]", "null", "{", "\"x\"", "{\"format\": 1}", "[".repeat(1e5)]) {
    assert.throws(() => read(joined(text, rest)), FileError, text.slice(0, 20));
  }
  assert.throws(() => read(changed((head) => { head.format = 2; })), /reload the page/);
  const long = bytes.slice();
  new DataView(long.buffer).setUint32(8, 0xffffffff, true);
  assert.throws(() => read(long), FileError);
});

test("names are names, whatever objects have of their own", () => {
  const made = read(changed((head) => {
    head.bodies[0].name = "__proto__";
    head.muscles[0] = "constructor";
    head.events[0].kind = "toString";
    head.events[0].text = "<b>\u202ex";
  }));
  assert.equal(made.bodies[0].name, "__proto__");
  assert.equal(eventWords(made.events[0]), "toString: <b>⟨U+202E⟩x");
});

test("states that do not last are left out", () => {
  const events = [[0.01, "leg_state"], [0.02, "leg_state"], [0.03, "target"], [0.05, "leg_state"], [0.1, "leg_state"],
    [0.5, "target"]].map(([time, kind]) => ({time, kind}));
  assert.deepEqual(lasting(events).map(({time}) => time), [0.03, 0.05, 0.1, 0.5]);
});

test("a target is a body of its own, on which no muscle is", () => {
  const made = read(changed((head) => {
    head.bodies[1].target = true;
    head.bodies[1].name = "root";
  }));
  assert.deepEqual(made.bodies.map((body) => body.target), [false, true]);
  const [{path: [point]}] = boundPaths([{name: "flexor", radius: 1, path: [{body: "root", wrap: null, at: [0, 0, 0]}]}],
    made, () => []);
  assert.equal(point.body, 0);
});

test("what a model tells is checked", () => {
  const extras = JSON.parse(fs.readFileSync("extras.json"));
  assert.equal(readModelExtras(extras).muscles.length, 2);
  for (const change of [(own) => { own.format = 2; }, (own) => { delete own.camera; },
    (own) => { own.camera.look_at = [0, 0]; }, (own) => { own.muscles[0].path[0].at = null; },
    (own) => { own.muscles = 3; }, (own) => { own.floor = {}; }]) {
    const own = structuredClone(extras);
    change(own);
    assert.throws(() => readModelExtras(own), FileError);
  }
  assert.throws(() => readModelExtras(undefined), FileError);
});

test("a clock plays, ends, steps and is set", () => {
  const clock = new Clock(1.01, 0.02);
  clock.play();
  clock.pass(0.1);
  close(clock.time, 0.1, 1e-12, "time");
  clock.pass(1e9);
  close(clock.time, 0.35, 1e-12, "no leap after a pause");
  for (let i = 0; i < 10; i += 1) clock.pass(0.2);
  assert.deepEqual([clock.time, clock.running, clock.ended], [1.01, false, true]);
  clock.step(-1);
  close(clock.time, 1, 1e-12, "the frame before the end");
  clock.step(1);
  assert.equal(clock.time, 1.01);
  clock.play();
  assert.equal(clock.time, 0);
  clock.step(1);
  assert.equal(clock.running, false);
  close(clock.time, 0.02, 1e-12, "a frame on");
  clock.seek(0.031);
  clock.step(1);
  close(clock.time, 0.04, 1e-12, "to the next frame");
  clock.seek(0.031);
  clock.step(-1);
  close(clock.time, 0.02, 1e-12, "to the frame before");
  clock.seek(-5);
  assert.equal(clock.time, 0);
  clock.seek(NaN);
  assert.equal(clock.time, 0);
  for (let i = 0; i < 9; i += 1) clock.faster(-1);
  assert.equal(clock.speed, 0.1);
  for (let i = 0; i < 9; i += 1) clock.faster(1);
  assert.equal(clock.speed, 2);
  const nothing = new Clock(0, 0.02);
  nothing.play();
  assert.equal(nothing.running, false);
});

function still(frames, duration, more = {}) {
  return {frames, period: 0.02, duration, bodies: [{name: "a"}], muscles: ["m"], wraps: 1,
    position: new Float32Array(3 * frames), rotation: new Float32Array(4 * frames).fill(0.5),
    activation: new Float32Array(frames), wrap: new Float32Array(7 * frames), ...more};
}

test("between frames things are in between, and the last frame may be a short one", () => {
  const episode = still(3, 0.03);
  episode.position.set([0, 0, 0, 2, 0, 0, 4, 0, 0]);
  assert.deepEqual(framesAt(episode, 0.01), {a: 0, b: 1, part: 0.5});
  const position = new Float32Array(3);
  const rotation = new Float32Array(4);
  for (const [time, x] of [[0, 0], [0.01, 1], [0.02, 2], [0.025, 3], [0.03, 4], [9, 4], [-1, 0]]) {
    posesAt(episode, time, position, rotation);
    close(position[0], x, 1e-5, `x at ${time}`);
    assert.deepEqual([...rotation], [0.5, 0.5, 0.5, 0.5]);
  }
  assert.equal(frameAt(episode, 0.03), 2);
  assert.equal(frameAt(episode, 0.0299), 1);
  const {position: alone} = still(1, 0);
  posesAt(still(1, 0), 0, position, rotation);
  assert.deepEqual([...position], [...alone]);
});

test("a body turns the short way", () => {
  const episode = still(2, 0.02);
  episode.rotation.set([1, 0, 0, 0, -0.8, 0, 0, -0.6]);
  const rotation = new Float32Array(4);
  posesAt(episode, 0.01, new Float32Array(3), rotation);
  close(rotation[0], 0.9 / Math.hypot(0.9, 0.3), 1e-6, "w");
  close(rotation[3], 0.3 / Math.hypot(0.9, 0.3), 1e-6, "z");
});

test("muscles run over their points and over wraps that are there", () => {
  const episode = still(2, 0.02);
  episode.rotation.set([Math.SQRT1_2, 0, 0, Math.SQRT1_2, Math.SQRT1_2, 0, 0, Math.SQRT1_2]);
  episode.position.set([0, 0, 1, 0, 0, 1]);
  episode.activation.set([0, 1]);
  episode.wrap.set([1, 0.1, 0, 0, 0.2, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
  const paths = boundPaths([{name: "m", radius: 0.01, path: [{body: "a", wrap: null, at: [1, 0, 0]},
    {body: "a", wrap: 0, at: null}, {body: "gone", wrap: null, at: [5, 0, 0]},
    {body: "a", wrap: 9, at: null}]}], episode, (_, at) => [at[0], 7, 0]);
  assert.equal(mostSegments(paths), 3);
  const pose = {position: new Float32Array(3), rotation: new Float32Array(4)};
  const ends = new Float32Array(6 * 3);
  const segments = new Float32Array(2 * 3);
  posesAt(episode, 0, pose.position, pose.rotation);
  assert.equal(segmentsAt(episode, paths, pose, 0, ends, segments), 3);
  const expected = [0, 1, 1, 0, 0.1, 1, 0, 0.1, 1, 0, 0.2, 1, 0, 0.2, 1, 5, 7, 0];
  expected.forEach((value, place) => close(ends[place], value, 1e-6, `end ${place}`));
  assert.equal(segmentsAt(episode, paths, pose, 0.02, ends, segments), 1);
  [0, 1, 1, 5, 7, 0].forEach((value, place) => close(ends[place], value, 1e-6, `end ${place}`));
  assert.equal(segments[0], 1);
});

test("the camera follows without a body's ups and downs", () => {
  const frames = 201;
  const episode = still(frames, 4);
  for (let i = 0; i < frames; i += 1) episode.position.set([0.01 * i, 0, i % 2], 3 * i);
  const path = followedPath(episode, "a", [0, 0, 5]);
  assert.equal(followedPath(episode, "b", [0, 0, 0]), null);
  const out = [0, 0, 0];
  pointAt(episode, path, 2, out);
  close(out[0], 1, 1e-4, "x");
  close(out[2], 5.5, 0.02, "z");
  pointAt(episode, path, 0, out);
  assert.equal(out[0], 0);
});

test("graphs tell values between frames, and labels as they are", () => {
  const episode = still(2, 0.02);
  close(valueAt(episode, {values: [1, 3], labels: null}, 0.01), 2, 1e-9, "between");
  assert.equal(valueAt(episode, {values: [1, 3], labels: ["a", "b", "c", "d"]}, 0.01), 1);
});

test("integers of 64 bits are read to the last digit, and all else as it is", () => {
  const text = '{"seed": 6917529027641081857, "list":[-9007199254740993,9007199254740991, 1.5e300,-0.1, 7],'
    + '"a \\" 6917529027641081857": "12345678901234567890", "deep":{"seed":9223372036854775807}, "no":null}';
  assert.deepEqual(parseJson(text), {
    seed: "6917529027641081857", list: ["-9007199254740993", 9007199254740991, 1.5e300, -0.1, 7],
    'a " 6917529027641081857': "12345678901234567890", deep: {seed: "9223372036854775807"}, no: null});
  assert.equal(parseJson("6917529027641081857"), "6917529027641081857");
  for (const broken of ["", "{", "<html>", '{"a": 1 2}']) assert.throws(() => parseJson(broken));
});

test("signing in leads to a page of this server only", () => {
  const origin = "https://grader.example.org:8443";
  globalThis.location = new URL(origin);
  const leads = (to) => target(new URLSearchParams({to}));
  assert.equal(leads("/board?track=a%2Fb&at=1#x"), `${origin}/board?track=a%2Fb&at=1#x`);
  assert.equal(leads(""), `${origin}/`);
  for (const to of ["/.//evil.example/x", "/..//evil.example/x", "//evil.example/x", "/\\evil.example/x",
    "\\\\evil.example", "/\t/evil.example", "/%2e//evil.example/x", "/a/..//evil.example", "/./\\evil.example",
    "https://evil.example/", "http:evil.example", "https://grader.example.org.evil.example/", "javascript:alert(1)",
    "data:text/html,x", `blob:${origin}/1`, `${origin}//evil.example`, "https://[", "http://grader.example.org:8443/"]) {
    const url = new URL(leads(to), origin);
    assert.equal(url.origin, origin, to);
    assert.ok(leads(to).startsWith(`${origin}/`), to);
  }
});

test("the form takes an archive of every ending that the server takes", async () => {
  const chosen = (path) => parcelOf([{path, file: new Blob(["archive"])}]);
  const endings = ["tar", "tar.gz", "tgz", "tar.zst", "tzst", "tar.xz", "txz", "tar.bz2", "tbz2", "tbz", "zip"];
  for (const ending of endings) {
    for (const path of [`walker.${ending}`, `WALKER.${ending.toUpperCase()}`]) {
      const parcel = await chosen(path);
      assert.equal(parcel.blob.size, 7, path);
      assert.ok(parcel.words.startsWith(path), path);
    }
    await assert.rejects(chosen("walker.py"), (error) => error.message.includes(`.${ending}`));
  }
  for (const path of ["walker", "tar", "a.tar.7z", "a.gz", "a.zip.txt"]) await assert.rejects(chosen(path), path);
});

test("a single program is packed with a manifest that starts it", async () => {
  for (const head of ["#!/bin/sh\n", "\x7fELF"]) {
    const {blob, words} = await parcelOf([{path: "walker", file: new Blob([head, "rest"])}]);
    const text = await blob.text();
    assert.ok(words.startsWith("the program walker"), words);
    assert.ok(text.includes('{"name":"walker","command":["./walker"]}'));
    assert.ok(text.includes(`${head}rest`));
  }
});

test("differences of pairs have Student's interval, wins and losses", () => {
  const found = pairedDifference([3, 4, 5, 6, 1], 1);
  close(found.mean, 3.8, 1e-12, "mean");
  close(found.low, 1.4116, 1e-3, "low");
  close(found.high, 6.1884, 1e-3, "high");
  assert.deepEqual([found.wins, found.losses, found.ties], [5, 0, 0]);
  const less = pairedDifference([-1, 0, 2, ...Array(27).fill(0.5)], -1);
  assert.deepEqual([less.wins, less.losses, less.ties], [1, 28, 1]);
  close(less.high - less.mean, 0.150990, 1e-4, "half of the interval");
  assert.deepEqual(pairedDifference([2], 0), {count: 1, mean: 2, low: null, high: null, wins: 0, ties: 0, losses: 1});
});

test("episodes are paired by their seeds, and only under the same rules", () => {
  const made = (seeds, hash, config = "c") => ({hashes: {seeds: hash, config}, episode_columns: {
    index: seeds.map((_, index) => index), seed: seeds, outcome: seeds.map((seed) => (seed === 4 ? "crash" : "success")),
    metrics: seeds.map((seed) => (seed === 4 ? null : {time_s: seed}))}});
  const pairs = pairsOf(made([3, 4, 5], "a"), made([5, 4, 9], "b"));
  assert.deepEqual(pairs, [[{success: 0}, {success: 0}], [{time_s: 5, success: 1}, {time_s: 5, success: 1}]]);
  // Hidden seeds are the same where their list is.
  const hidden = (seeds) => {
    const one = made(seeds, "a");
    one.episode_columns.seed = seeds.map(() => null);
    return one;
  };
  assert.equal(pairsOf(hidden([1, 2]), hidden([1, 2])).length, 2);
  assert.throws(() => pairsOf(made([1], "a"), made([1], "a", "d")), /other rules/);
});

test("a series may be a target in another's graph", () => {
  const made = read(changed((head) => Object.assign(head.series[1], {graph: "distance", tolerance: 0.5})));
  assert.deepEqual(made.series.map(({graph, tolerance}) => [graph, tolerance]), [[null, 0], ["distance", 0.5], [null, 0]]);
  for (const wrong of [{graph: 7}, {tolerance: "wide"}, {tolerance: null}]) {
    assert.throws(() => read(changed((head) => Object.assign(head.series[1], wrong))), FileError);
  }
});

test("a board has the digits that tell its rows apart", () => {
  const digits = (values, most = 6) => briefly({columns: [{name: "effort", digits: most}],
    rows: values.map((effort) => ({aggregate: {effort}}))})[0].digits;
  assert.equal(digits([0.3548, 0.4646, 0.5913]), 3);
  assert.equal(digits([0.35481, 0.35482, 28.9]), 5);
  assert.equal(digits([28.9089, 27.1, null]), 1);
  assert.equal(digits([4000, 5000]), 0);
  assert.equal(digits([0.2, 0.2]), 3);
  assert.equal(digits([0.00001234, 0], 4), 4);
  assert.equal(digits([0, null, undefined]), 0);
});

test("bodies that touch are named, if the file names them", () => {
  const {contacts} = read(bytes);
  assert.deepEqual([0, 1].map(contacts.bodiesOf), [["root", ""], ["arm", "root"]]);
  assert.equal(read(changed((head) => { delete head.arrays.contact_body; })).contacts.bodiesOf, null);
  for (const lie of [(head) => { head.bodies.pop(); }, (head) => { head.arrays.contact_body.length -= 1; },
    (head) => { head.arrays.contact_body = null; }]) {
    assert.throws(() => read(changed(lie)), FileError);
  }
});

test("a field is no course", () => {
  assert.ok(isCourse({low: [-1.5, -60], high: [1.5, 60]}));
  assert.ok(!isCourse({low: [-6, -6], high: [6, 6]}));
});

test("a course goes to the right from where the episode starts", () => {
  const course = courseOf(read(bytes));
  assert.deepEqual([course.axis, course.way], [1, -1]);
  close(course.along[0], 0, 1e-9, "start");
  close(course.along.at(-1), 9.6, 1e-3, "end");
  assert.deepEqual([course.from, course.to].map((one) => Number(one.toFixed(3))), [-2, 12]);
});
