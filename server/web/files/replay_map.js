// The terrain of an episode from above, with the way of its first body and metres from its start.
import {rangeOf, ticks} from "./charts.js";
import {h, s} from "./dom.js";
import {number} from "./format.js";
import {framesAt} from "./replay_pose.js";

const WIDTH = 360;
const HEIGHT = 64;
const BASE = 42;       // below it are the marks
const BEFORE_M = 2;    // of the terrain before the start
const AHEAD_M = 8;     // after the farthest point
const MOST_POINTS = 500;
const LONG = 4;        // times as long as wide: less is a field, over which no way leads

// Whether a terrain leads somewhere, so that metres along it tell how far an episode came.
export function isCourse({low, high}) {
  const sides = [0, 1].map((axis) => high[axis] - low[axis]);
  return Math.max(...sides) >= LONG * Math.min(...sides);
}

// Where the terrain and the way are in the drawing: along the axis on which the terrain is longest, with the way to
// the right. `along` is how far on it a point is from the start, in m.
export function courseOf({terrain, position, bodies, frames}) {
  const axis = terrain.high[1] - terrain.low[1] > terrain.high[0] - terrain.low[0] ? 1 : 0;
  const at = (frame, of) => position[3 * bodies.length * frame + of];
  const start = at(0, axis);
  const moved = Array.from({length: frames}, (_, frame) => at(frame, axis) - start);
  const [low, high] = rangeOf(moved);
  const way = -low > high ? -1 : 1;
  const ends = [terrain.low[axis], terrain.high[axis]].map((end) => way * (end - start)).sort((a, b) => a - b);
  const farthest = Math.max(way * low, way * high);
  return {axis, way, start, along: moved.map((one) => way * one),
    aside: Array.from({length: frames}, (_, frame) => at(frame, 1 - axis)),
    from: Math.max(ends[0], -BEFORE_M), to: Math.max(Math.min(ends[1], farthest + AHEAD_M), 1)};
}

// Bright where the terrain is high.
function paint(canvas, {terrain}, course) {
  const {rows, columns, low, high, heights} = terrain;
  const [bottom, top] = rangeOf(heights);
  const counts = [columns, rows];
  canvas.width = WIDTH;
  canvas.height = BASE;
  const context = canvas.getContext("2d");
  const image = context.createImageData(WIDTH, BASE);
  const cell = (axis, value) => Math.round(Math.min(Math.max((value - low[axis]) / (high[axis] - low[axis]), 0), 1)
    * (counts[axis] - 1));
  for (let x = 0; x < WIDTH; x += 1) {
    const forward = course.start + course.way * (course.from + (course.to - course.from) * x / WIDTH);
    for (let y = 0; y < BASE; y += 1) {
      const across = low[1 - course.axis] + (high[1 - course.axis] - low[1 - course.axis]) * y / BASE;
      const [column, row] = course.axis ? [cell(0, across), cell(1, forward)] : [cell(0, forward), cell(1, across)];
      const shade = 120 + 115 * (heights[column * rows + row] - bottom) / (top - bottom);
      image.data.set([shade, shade, shade, 255], 4 * (y * WIDTH + x));
    }
  }
  context.putImageData(image, 0, 0);
}

// The map of an episode along a course, as graphs are: an element and show(time, told).
export function courseMap(one, several) {
  const {trajectory} = one;
  const course = courseOf(trajectory);
  const {low, high} = trajectory.terrain;
  const other = 1 - course.axis;
  const x = (along) => WIDTH * (along - course.from) / (course.to - course.from);
  const y = (aside) => BASE * Math.min(Math.max((aside - low[other]) / (high[other] - low[other]), 0), 1);
  const step = Math.max(Math.ceil(trajectory.frames / MOST_POINTS), 1);
  const points = course.along.map((along, frame) => `${x(along).toFixed(1)},${y(course.aside[frame]).toFixed(1)}`)
    .filter((_, frame) => frame % step === 0 || frame === trajectory.frames - 1).join(" ");
  const dot = s("circle", {class: "place", r: 4});
  const canvas = h("canvas", {"aria-hidden": "true"});
  paint(canvas, trajectory, course);
  const end = course.along.at(-1);
  const drawing = s("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label":
    `The course from above: at the end ${number(end, 1)} m from the start`},
  s("polyline", {class: "line", points}), dot, ticks(course.from, course.to, 8).map((value) => [
    s("line", {class: "axis", x1: x(value), x2: x(value), y1: BASE, y2: BASE + 4}),
    s("text", {x: x(value), y: BASE + 17, "text-anchor": x(value) > WIDTH - 12 ? "end" : x(value) < 8 ? "start"
      : "middle"}, `${value} m`)]));
  const now = h("b", {class: one.mark});
  const element = h("figure", {class: "chart graph"}, h("figcaption", null, "Course from above",
    several && h("span", {class: one.mark}, ` ${one.label}`), " ", h("span", {class: "now"}, now)),
  h("div", {class: "course-map"}, canvas, drawing));
  return {element, show(time, told) {
    const {a, b, part} = framesAt(trajectory, time);
    const between = (values) => values[a] + part * (values[b] - values[a]);
    dot.setAttribute("cx", x(between(course.along)));
    dot.setAttribute("cy", y(between(course.aside)));
    if (told) now.textContent = `${number(between(course.along), 1)} m`;
  }};
}
