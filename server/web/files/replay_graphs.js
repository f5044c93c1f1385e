// Graphs over an episode's time that follow its replay. Two episodes share a graph; the second's line is
// dashed.
import {label, rangeOf, ticks} from "./charts.js";
import {h, s} from "./dom.js";
import {number, visible} from "./format.js";
import {courseMap, isCourse} from "./replay_map.js";
import {frameAt, framesAt} from "./replay_pose.js";

const WIDTH = 360;
const HEIGHT = 120;
const LEFT = 42;
const RIGHT = 12;
const TOP = 6;
const BOTTOM = 20;
const MOST_POINTS = 700;

export function valueAt(trajectory, series, time) {
  if (series.labels) return series.values[frameAt(trajectory, time)];
  const {a, b, part} = framesAt(trajectory, time);
  return series.values[a] + part * (series.values[b] - series.values[a]);
}

function digitsOf(low, high) {
  return Math.min(Math.max(2 - Math.floor(Math.log10(Math.max(high - low, 1e-9))), 0), 4);
}

function shownValue(series, value, digits) {
  if (series.labels) return visible(series.labels[Math.round(value)] ?? "–");
  return number(value, digits) + (series.unit ? ` ${visible(series.unit)}` : "");
}

// Of many frames the lowest and the highest of each part, so that no peak is lost.
function thinned(values, most) {
  if (values.length <= most) return Array.from(values, (value, frame) => [frame, value]);
  const made = [];
  const size = 2 * values.length / most;
  for (let first = 0; first < values.length; first += size) {
    const own = [];
    for (let i = Math.floor(first); i < Math.min(Math.floor(first + size), values.length); i += 1) {
      own.push([i, values[i]]);
    }
    if (!own.length) continue;
    const low = own.reduce((best, one) => (one[1] < best[1] ? one : best));
    const high = own.reduce((best, one) => (one[1] > best[1] ? one : best));
    made.push(...(low[0] < high[0] ? [low, high] : [high, low]));
  }
  return made;
}

function points(trajectory, series, x, y) {
  const at = (frame) => x(Math.min(frame * trajectory.period, trajectory.duration));
  const made = [];
  let before = null;
  for (const [frame, value] of thinned(series.values, MOST_POINTS)) {
    if (series.labels && before !== null && value !== before) {
      made.push(`${at(frame).toFixed(1)},${y(before).toFixed(1)}`);
    }
    made.push(`${at(frame).toFixed(1)},${y(value).toFixed(1)}`);
    before = value;
  }
  return made.join(" ");
}

function words(one, digits) {
  const [low, high] = rangeOf(one.series.values);
  const last = one.series.values.at(-1);
  if (one.series.labels) return `ends as ${shownValue(one.series, last)}`;
  return `from ${number(low, digits)} to ${number(high, digits)}, at the end `
    + shownValue(one.series, last, digits);
}

// A line down through a drawing at the time that is shown.
function cursor() {
  return s("line", {class: "cursor", x1: LEFT, x2: LEFT, y1: TOP, y2: HEIGHT - BOTTOM});
}

// Numbers beside an axis, with as many decimals as tell them apart.
function levelWords(levels) {
  const step = levels.length > 1 ? levels[1] - levels[0] : Math.abs(levels[0] ?? 1);
  const digits = Math.min(Math.max(-Math.floor(Math.log10(Math.max(step, 1e-9)) + 1e-6), 0), 6);
  return levels.map((value) => (Math.abs(value) >= 10000 ? label(value) : value.toFixed(digits)));
}

function timeAxis(duration, x) {
  const base = HEIGHT - BOTTOM;
  return [s("line", {class: "axis", x1: LEFT, x2: WIDTH - RIGHT, y1: base, y2: base}),
    ticks(0, duration, 5).map((value) => [
      s("line", {class: "axis", x1: x(value), x2: x(value), y1: base, y2: base + 4}),
      s("text", {x: x(value), y: base + 15, "text-anchor": "middle"},
        value ? label(value) : "0 s")])];
}

// Lets a press on a drawing choose the time.
function seekable(drawing, duration, onSeek) {
  const seek = (event) => {
    const box = drawing.getBoundingClientRect();
    const at = (event.clientX - box.left) / box.width * WIDTH;
    onSeek((at - LEFT) / (WIDTH - LEFT - RIGHT) * duration);
  };
  drawing.addEventListener("pointerdown", (event) => {
    drawing.setPointerCapture(event.pointerId);
    seek(event);
  });
  drawing.addEventListener("pointermove", (event) => {
    if (drawing.hasPointerCapture(event.pointerId)) seek(event);
  });
}

// A series that is drawn in another's graph: its line, and what is within its tolerance.
function guide(one, series, x, y) {
  const at = (frame) => x(Math.min(frame * one.trajectory.period, one.trajectory.duration)).toFixed(1);
  const edge = (way) => thinned(series.values, MOST_POINTS).map(([frame, value]) =>
    `${at(frame)},${y(value + way * series.tolerance).toFixed(1)}`);
  return [series.tolerance > 0 && s("polygon", {class: "tolerance",
    points: [...edge(1), ...edge(-1).reverse()].join(" ")}),
  s("polyline", {class: "line guide", points: points(one.trajectory, series, x, y)})];
}

// `own` has an episode's series each, and `guides`, those that are drawn in its graph.
function graph(own, duration, onSeek) {
  const {series} = own[0];
  const guides = own.flatMap((one) => one.guides.map((guided) => ({one, series: guided})));
  const all = own.flatMap((one) => rangeOf(one.series.values)).concat(guides.flatMap(({series: guided}) =>
    rangeOf(guided.values).flatMap((value) => [value - guided.tolerance, value + guided.tolerance])));
  const [low, high] = series.labels ? [-0.5, series.labels.length - 0.5]
    : rangeOf(all.concat(rangeOf(all)));
  const digits = digitsOf(low, high);
  const x = (time) => LEFT + (WIDTH - LEFT - RIGHT) * time / duration;
  const y = (value) => TOP + (HEIGHT - BOTTOM - TOP) * (high - value) / (high - low);
  const levels = series.labels ? series.labels.map((_, place) => place) : ticks(low, high, 4);
  const beside = series.labels ? levels.map((place) => place + 1) : levelWords(levels);
  const line = cursor();
  const legend = [...new Map(guides.map(({series: guided}) => [guided.name, guided])).values()].map((guided) =>
    `dashed: ${visible(guided.title).toLowerCase()}${guided.tolerance ? `, ± ${number(guided.tolerance, digits)} ${
      visible(guided.unit)}`.trimEnd() : ""}`);
  const drawing = s("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img",
    "aria-label": `${visible(series.title)} over time: ${own.map((one) =>
      (own.length > 1 ? `${one.label} ` : "") + words(one, digits)).concat(legend).join("; ")}`},
  levels.map((value, place) => [
    s("line", {class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value)}),
    s("text", {x: LEFT - 5, y: y(value) + 4, "text-anchor": "end"},
      beside[place])]),
  timeAxis(duration, x),
  guides.map(({one, series: guided}) => guide(one, guided, x, y)),
  own.map((one) => s("polyline", {class: `line ${one.mark}`,
    points: points(one.trajectory, one.series, x, y)})), line);
  seekable(drawing, duration, onSeek);
  const shown = own.map((one) => h("b", {class: one.mark}));
  const title = visible(series.title) + (series.unit ? ` (${visible(series.unit)})` : "");
  const element = h("figure", {class: "chart graph"}, h("figcaption", null, title, " ",
    h("span", {class: "now"}, shown)), drawing, legend.length > 0 && h("p", {class: "quiet"}, legend.join("; ")),
  series.labels && h("p", {class: "quiet"},
    series.labels.map((text, place) => `${place + 1}: ${visible(text)}`).join(", ")));
  return {element, show(time, told) {
    const at = x(Math.min(time, duration)).toFixed(1);
    line.setAttribute("x1", at);
    line.setAttribute("x2", at);
    if (!told) return;
    own.forEach((one, place) => {
      shown[place].textContent = shownValue(one.series, valueAt(one.trajectory, one.series, time),
        digits);
    });
  }};
}

// Dark where a muscle rests, bright where it is fully active; light and dark differ for every reader.
function shade(active) {
  const way = (low, middle, high) => (active < 0.5 ? low + 2 * active * (middle - low)
    : middle + (2 * active - 1) * (high - middle));
  return [way(22, 190, 255), way(26, 55, 214), way(52, 60, 92)];
}

function paint(canvas, trajectory) {
  const columns = Math.min(trajectory.frames, MOST_POINTS);
  const rows = trajectory.muscles.length;
  canvas.width = columns;
  canvas.height = rows;
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  for (let column = 0; column < columns; column += 1) {
    const frame = Math.floor(column * trajectory.frames / columns);
    for (let row = 0; row < rows; row += 1) {
      const [r, g, b] = shade(trajectory.activation[frame * rows + row]);
      image.data.set([r, g, b, 255], 4 * (row * columns + column));
    }
  }
  context.putImageData(image, 0, 0);
}

function meanActivation(trajectory) {
  let sum = 0;
  for (const value of trajectory.activation) sum += value;
  return sum / Math.max(trajectory.activation.length, 1);
}

// The most active muscles at a time, in words.
function mostActive(trajectory, time) {
  const first = frameAt(trajectory, time) * trajectory.muscles.length;
  return trajectory.muscles.map((name, place) => [trajectory.activation[first + place], name])
    .sort((a, b) => b[0] - a[0]).slice(0, 3).filter(([value]) => value > 0.01)
    .map(([value, name]) => `${visible(name)} ${number(value, 2)}`).join(", ") || "all at rest";
}

function muscleMap(one, several, duration, onSeek) {
  const {trajectory} = one;
  const canvas = h("canvas", {role: "img", "aria-label": `Activation of ${trajectory.muscles.length} `
    + `muscles over time${several ? `, ${one.label}` : ""}: mean `
    + number(meanActivation(trajectory), 2)});
  paint(canvas, trajectory);
  const line = h("span", {class: "cursor"});
  const now = h("p", {class: "quiet"});
  const box = h("div", {class: "muscles"}, canvas, line);
  const part = trajectory.duration / duration;
  canvas.style.width = `${100 * part}%`;
  const seek = (event) => {
    const area = box.getBoundingClientRect();
    onSeek((event.clientX - area.left) / area.width * duration);
  };
  box.addEventListener("pointerdown", seek);
  const element = h("figure", {class: "chart graph"}, h("figcaption", null, "Muscles' activation",
    several && h("span", {class: one.mark}, ` ${one.label}`)), box, now,
  h("p", {class: "quiet scale"}, "0", h("span", {class: "shades", "aria-hidden": "true"}), "1; a row for "
    + `each of ${trajectory.muscles.length} muscles, time to the right`));
  return {element, show(time, told) {
    line.style.left = `${100 * Math.min(time / duration, 1)}%`;
    if (told) now.textContent = `Most active: ${mostActive(trajectory, time)}`;
  }};
}

// Graphs of episodes: {trajectory, label, mark}, of which `mark` is a class. `onSeek` is called with the
// time that a reader chose. Returns the element and show(time, told), where only with `told` the values
// in words are renewed.
export function graphs(episodes, duration, onSeek) {
  const series = episodes.flatMap((one) => one.trajectory.series);
  // One that would be drawn in a graph that there is not has its own.
  const guided = (one) => one.graph !== null && !one.labels && series.some((other) => other.name === one.graph
    && other.graph === null && !other.labels);
  const names = [...new Set(series.filter((one) => !guided(one)).map((one) => one.name))];
  const long = Math.max(duration, 1e-3);
  const all = names.map((name) => graph(episodes.map((one) => ({...one,
    series: one.trajectory.series.find((other) => other.name === name),
    guides: one.trajectory.series.filter((other) => guided(other) && other.graph === name)}))
    .filter((one) => one.series), long, onSeek));
  all.unshift(...episodes.filter(({trajectory}) => trajectory.terrain && isCourse(trajectory.terrain))
    .map((one) => courseMap(one, episodes.length > 1)));
  all.push(...episodes.filter((one) => one.trajectory.muscles.length)
    .map((one) => muscleMap(one, episodes.length > 1, long, onSeek)));
  return {element: h("div", {class: "charts", tabindex: 0, role: "group", "aria-label": "Graphs"}, all.map((one) => one.element)),
    show: (time, told) => all.forEach((one) => one.show(time, told))};
}
