// Charts as SVG. Each says in words what it shows, for those who don't see it.
import {h, s, table} from "./dom.js";
import {briefly, measure, number, whole} from "./format.js";

const WIDTH = 360;
const HEIGHT = 150;
const LEFT = 34;
const BOTTOM = 22;
const TOP = 8;
const BINS = 24;

// A round step so that about `count` of them cover `span`.
function roundStep(span, count) {
  const rough = span / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((one) => one * power).find((step) => step >= rough);
}

export function ticks(low, high, count) {
  const step = roundStep(high - low, count);
  const all = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-6; value += step) {
    all.push(Math.abs(value) < step * 1e-6 ? 0 : value);
  }
  return all;
}

// With as many digits as tell values apart that lie `step` from each other.
export function label(value, step = 0) {
  if (Math.abs(value) >= 10000) return value.toExponential(0);
  const digits = step > 0 && value ? Math.ceil(Math.log10(Math.abs(value) / step) + 1) : 3;
  return String(Number(value.toPrecision(Math.min(Math.max(digits, 3), 12))));
}

function quantile(sorted, part) {
  return sorted[Math.round(part * (sorted.length - 1))];
}

// An axis at the height `base`.
function axisAt(base, low, high, x, left = LEFT) {
  const step = roundStep(high - low, 5);
  // Long labels need room.
  const shown = ticks(low, high, label(high, step).length > 6 ? 3 : 5);
  return [s("line", {class: "axis", x1: left, x2: WIDTH - 6, y1: base, y2: base}),
    shown.map((value) => [
      s("line", {class: "axis", x1: x(value), x2: x(value), y1: base, y2: base + 4}),
      s("text", {x: x(value), y: base + 15, "text-anchor": x(value) > WIDTH - 20 ? "end" : "middle"},
        label(value, step))])];
}

function xAxis(low, high, x) {
  return axisAt(HEIGHT - BOTTOM, low, high, x);
}

export function rangeOf(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

function figure(title, words, drawing, legend) {
  return h("figure", {class: "chart"}, h("figcaption", null, title),
    s("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${title}: ${words}`},
      drawing), legend, h("p", {class: "quiet"}, words));
}

// How often which value occurred. `points`: {value, outcome}; `metric` as the API describes it.
export function histogram(title, points, metric) {
  const values = points.map((point) => point.value).sort((a, b) => a - b);
  if (!values.length) return null;
  const told = [values[0], values.at(-1), quantile(values, 0.5)];
  const [brief] = briefly({columns: [metric], rows: told.map((value) => ({aggregate: {[metric.name]: value}}))});
  const [lowest, highest, median] = told.map((value) => measure(value, brief));
  const words = `${whole(values.length)} episodes, from ${lowest} to ${highest}, median ${median}`;
  const [low, high] = rangeOf(values);
  const x = (value) => LEFT + (WIDTH - 10 - LEFT) * (value - low) / (high - low);
  const bins = Array.from({length: BINS}, () => ({success: 0, other: 0}));
  for (const point of points) {
    const place = Math.min(Math.floor(BINS * (point.value - low) / (high - low)), BINS - 1);
    bins[place][point.outcome === "success" ? "success" : "other"] += 1;
  }
  const most = Math.max(...bins.map((bin) => bin.success + bin.other));
  const tall = (count) => (HEIGHT - BOTTOM - TOP) * count / most;
  const wide = (WIDTH - 10 - LEFT) / BINS;
  const bars = bins.map((bin, place) => {
    const at = LEFT + place * wide;
    const base = HEIGHT - BOTTOM;
    return [
      bin.success > 0 && s("rect", {class: "bar success", x: at + 0.5, width: wide - 1,
        y: base - tall(bin.success), height: tall(bin.success)}),
      bin.other > 0 && s("rect", {class: "bar failure", x: at + 0.5, width: wide - 1,
        y: base - tall(bin.success + bin.other), height: tall(bin.other)})];
  });
  const counts = ticks(0, most, 3).filter(Number.isInteger).map((count) => [
    s("line", {class: "grid", x1: LEFT, x2: WIDTH - 10, y1: HEIGHT - BOTTOM - tall(count),
      y2: HEIGHT - BOTTOM - tall(count)}),
    s("text", {x: LEFT - 5, y: HEIGHT - BOTTOM - tall(count) + 4, "text-anchor": "end"},
      whole(count))]);
  const middle = x(quantile(values, 0.5));
  return figure(title, words, [counts, bars,
    s("line", {class: "median", x1: middle, x2: middle, y1: TOP, y2: HEIGHT - BOTTOM}),
    xAxis(low, high, x)]);
}

// Where along an axis something was, a line of dots for each kind. `points`: {value, kind, outcome,
// index}. `order`: of the kinds, if not that of the alphabet.
export function strips(title, points, metric, order = null) {
  if (!points.length) return null;
  const present = new Set(points.map((point) => point.kind));
  const kinds = order ? order.filter((kind) => present.has(kind)) : [...present].sort();
  const [low, high] = rangeOf(points.map((point) => point.value));
  const left = 84;
  const x = (value) => left + (WIDTH - 12 - left) * (value - low) / (high - low);
  const row = (HEIGHT - BOTTOM - TOP) / kinds.length;
  const lines = kinds.map((kind, place) => {
    const y = TOP + row * (place + 0.5);
    const own = points.filter((point) => point.kind === kind);
    return [s("text", {x: left - 8, y: y + 4, "text-anchor": "end"}, kind),
      s("line", {class: "grid", x1: left, x2: WIDTH - 12, y1: y, y2: y}),
      own.slice(0, 1000).map((point) => s("circle", {class: `dot ${point.outcome}`,
        cx: x(point.value), cy: y + (point.index * 0.618 % 1 - 0.5) * Math.min(row * 0.7, 22),
        r: 2.6}))];
  });
  const words = kinds.map((kind) => {
    const own = points.filter((point) => point.kind === kind).map((point) => point.value)
      .sort((a, b) => a - b);
    return `${kind}: ${whole(own.length)}, median ${number(quantile(own, 0.5), 2)} ${metric.unit}`;
  }).join("; ");
  return figure(title, words, [lines, xAxis(low, high, x)]);
}

// Bars of shares, one for each kind: {kind, part, of}.
export function shares(title, rows, unit) {
  return h("figure", {class: "chart"}, h("figcaption", null, title),
    h("ul", {class: "shares"}, rows.map((row) => h("li", null, h("span", null, row.kind),
      h("meter", {min: 0, max: Math.max(row.of, 1e-12), value: row.part, "aria-label":
        `${row.kind}: ${row.text}`}), h("span", {class: "num"}, row.text)))),
    unit && h("p", {class: "quiet"}, unit));
}

// Ranges within limits, a line for each: {name, low, high, limit_low, limit_high}, all in one unit. What
// is beyond a limit is marked.
export function ranges(title, rows, unit) {
  const row = 17;
  const left = 128;
  const tall = TOP + rows.length * row + BOTTOM;
  const [low, high] = rangeOf(rows.flatMap((one) => [one.low, one.high, one.limit_low,
    one.limit_high]));
  const x = (value) => left + (WIDTH - 10 - left) * (value - low) / (high - low);
  const bar = (kind, from, to, y) => to > from && s("rect", {class: kind, x: x(from),
    width: Math.max(x(to) - x(from), 1), y: y - 3.5, height: 7, rx: 2});
  const lines = rows.map((one, place) => {
    const y = TOP + row * (place + 0.5);
    return [s("text", {x: left - 8, y: y + 4, "text-anchor": "end"}, one.name),
      s("line", {class: "limits", x1: x(one.limit_low), x2: x(one.limit_high), y1: y, y2: y}),
      bar("bar within", Math.max(one.low, one.limit_low), Math.min(one.high, one.limit_high), y),
      bar("bar failure", one.low, Math.min(one.high, one.limit_low), y),
      bar("bar failure", Math.max(one.low, one.limit_high), one.high, y)];
  });
  const beyond = rows.filter((one) => one.low < one.limit_low || one.high > one.limit_high)
    .map((one) => one.name);
  const words = beyond.length ? `Beyond their limits: ${beyond.join(", ")}.`
    : "All stay within their limits.";
  const numbers = h("details", null, h("summary", null, "Numbers"), table(`${title}, numbers`,
    ["Joint", `Lowest (${unit})#`, `Highest (${unit})#`, `Limits (${unit})#`], rows.map((one) =>
      h("tr", null, h("th", {scope: "row"}, one.name), h("td", {class: "num"}, number(one.low, 1)),
        h("td", {class: "num"}, number(one.high, 1)), h("td", {class: "num"},
          `${number(one.limit_low, 1)} to ${number(one.limit_high, 1)}`)))));
  return h("figure", {class: "chart"}, h("figcaption", null, title),
    s("svg", {viewBox: `0 0 ${WIDTH} ${tall}`, role: "img", "aria-label": `${title}: ${words}`},
      lines, axisAt(tall - BOTTOM, low, high, x, left)),
    h("p", {class: "quiet"}, words), numbers);
}
