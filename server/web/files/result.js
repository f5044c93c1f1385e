// What came out of an evaluation: figures, charts and output.
import {histogram, shares, strips} from "./charts.js";
import {summaryCharts, times} from "./details.js";
import {h, replace} from "./dom.js";
import {briefly, bytes, episodesText, heading, measure, number, percent, visible, whole} from "./format.js";
import {kindOf, verdict} from "./grid.js";
import {picture} from "./pictures.js";
import {filesOf, replayAddress} from "./replays.js";

const COURSES = ["flat", "hilly", "rough", "stairs", "mixed"];
const FORCE = {name: "peak_force", title: "peak force", unit: "N", digits: 1};

function tile(title, value, more, exact = null) {
  return h("div", {class: "tile"}, h("dt", null, title), h("dd", null, h("b", {title: exact}, value),
    more && h("span", {class: "interval"}, more)));
}

function spread(aggregate, metric) {
  const known = aggregate.spread?.[metric.name];
  if (!known || known.low === null || known.low === undefined) return null;
  return `95 %: ${number(known.low, metric.digits)} to ${number(known.high, metric.digits)}`;
}

// Trials that the official code counts and ends at once, because the one before was solved.
const isPlayed = (row) => row.reason !== "phantom";

// The rate without phantoms, where there are any.
function playedTile(result) {
  const all = result.aggregate;
  const played = all.episodes - (result.reasons?.phantom ?? 0);
  return played < all.episodes && played > 0 && tile("Success without phantoms",
    percent(all.successes, played), `${whole(all.successes)} of ${whole(played)} played`);
}

function tiles(result) {
  const all = result.aggregate;
  if (!all) return null;
  const brief = briefly({columns: result.metrics, rows: [result]});
  return h("dl", {class: "tiles"},
    tile("Success", percent(all.successes, all.episodes),
      `${whole(all.successes)} of ${whole(all.episodes)} episodes`),
    playedTile(result),
    brief.map((metric, place) => typeof all[metric.name] === "number" && metric.name !== "success_rate"
      && tile(heading({...metric, unit: ""}), measure(all[metric.name], metric), spread(all, metric),
        measure(all[metric.name], result.metrics[place]))));
}

function values(rows, of) {
  return rows.map((row) => ({value: of(row), outcome: kindOf(row), index: row.index,
    kind: row.reason || row.outcome || "withheld"}))
    .filter((point) => typeof point.value === "number" && Number.isFinite(point.value));
}

function distributions(result, rows) {
  const charts = result.metrics.filter((metric) => metric.name !== "success").map((metric) =>
    histogram(heading(metric), values(rows, (row) => row.metrics?.[metric.name]),
      metric));
  const force = values(rows, (row) => row.facts?.[FORCE.name]);
  if (force.length && !result.metrics.some((metric) => metric.name.includes("force"))) {
    charts.push(histogram("Peak force (N)", force, FORCE));
  }
  return charts.filter((chart) => chart);
}

function endings(result, rows) {
  const ended = rows.filter((row) => kindOf(row) !== "success" && kindOf(row) !== "withheld");
  const distance = result.metrics.find((metric) => metric.name === "distance_m");
  return [
    strips("When episodes failed (s of simulated time)",
      values(ended, (row) => row.sim_time_s), {unit: "s"}),
    distance && strips("Where episodes failed (m from the start)",
      values(ended, (row) => row.metrics?.distance_m), {unit: "m"}),
  ];
}

// Of a track whose episodes have different courses: how each kind went.
function courses(result, rows) {
  const known = rows.filter((row) => Number.isInteger(row.facts?.course));
  if (!known.length) return null;
  const distance = result.metrics.find((metric) => metric.name === "distance_m");
  const kinds = [...new Set(known.map((row) => row.facts.course))].sort((a, b) => a - b);
  const mean = (own) => own.reduce((sum, row) => sum + row.metrics.distance_m, 0) / own.length;
  const farthest = Math.max(...known.map((row) => row.metrics?.distance_m ?? 0), 1);
  return [
    shares("Success by kind of course", kinds.map((kind) => {
      const own = known.filter((row) => row.facts.course === kind);
      const part = own.filter((row) => row.outcome === "success").length;
      return {kind: COURSES[kind] ?? `course ${kind}`, part, of: own.length,
        text: `${part} of ${own.length}`};
    })),
    distance && shares("Mean distance by kind of course", kinds.map((kind) => {
      const own = known.filter((row) => row.facts.course === kind
        && typeof row.metrics?.distance_m === "number");
      return {kind: COURSES[kind] ?? `course ${kind}`, part: own.length ? mean(own) : 0,
        of: farthest, text: own.length ? measure(mean(own), distance) : "–"};
    })),
  ];
}

function reasons(result, rows) {
  const counts = {...result.outcomes};
  if (!rows.length || !Object.keys(counts).length) return null;
  const failures = Object.entries(result.reasons ?? {});
  const others = Object.entries(counts).filter(([kind]) => kind !== "failure");
  const all = [...others, ...failures].sort((a, b) => b[1] - a[1]);
  return shares("How episodes ended", all.map(([kind, part]) => ({kind, part, of: rows.length,
    text: `${whole(part)} of ${whole(rows.length)}`})));
}

function stream(title, text, truncated) {
  if (!text) return null;
  return [h("h4", null, title, truncated ? " (its end)" : ""),
    h("pre", {tabindex: 0, "aria-label": title}, visible(text))];
}

function outputOf(block) {
  return h("details", {class: "card", "data-block": block.block}, h("summary", null,
    `${episodesText(block.first, block.last)}: ${number(block.policy_cpu_s, 1)} s of CPU time`
    + `${block.startup_cpu_s === undefined ? "" : `, ${number(block.startup_cpu_s, 1)} s of it to start`}, `
    + `${bytes(block.peak_memory_bytes)} of memory`,
  block.stderr_tail && [" ", h("span", {class: "tag"}, "standard error")]),
  stream("Standard output", block.stdout_tail, block.stdout_truncated),
  stream("Standard error", block.stderr_tail, block.stderr_truncated),
  !block.stdout_tail && !block.stderr_tail && h("p", {class: "quiet"}, "It printed nothing."));
}

// Adds what was printed to `box`, and leaves what is there as it is, open or not.
export function addOutput(box, result) {
  if (!result.output?.length) return;
  if (!box.firstChild) box.append(h("h2", null, "Output"));
  for (const block of result.output) {
    if (!box.querySelector(`[data-block="${block.block}"]`)) box.append(outputOf(block));
  }
}

// Pictures of the best, the median and the worst episode, by the order of the board.
export function highlights(rows, metrics, submission) {
  const shown = Object.entries(rows ?? {}).filter(([, row]) => row.log);
  if (!shown.length) return null;
  const first = metrics.find((metric) => metric.better !== "neither" && metric.name !== "success");
  return h("section", null, h("h2", null, "How it looks"), h("div", {class: "pictures"},
    shown.map(([place, row]) => {
      const figures = first ? `, ${measure(row.metrics?.[first.name], first)}` : "";
      const words = `Episode ${row.index}, ${verdict(row)}${figures}`;
      const link = h("a", {href: replayAddress({log: row.log.sha256, of: submission})}, words);
      return picture(filesOf(row.log.sha256), `A moment of the ${place} episode: ${words}`,
        place === "only" ? link : [`The ${place}: `, link]);
    })));
}

function notices(result) {
  return [
    result.withheld?.length > 0 && h("p", {class: "notice"}, "The phase withholds until it is "
      + `published: ${result.withheld.join(", ")}.`),
    result.not_repeatable?.length > 0 && h("p", {class: "problem"},
      `${result.not_repeatable.length} episodes had another result when they were played again.`)];
}

export function drawFigures(box, result) {
  replace(box, notices(result), tiles(result));
}

export function drawCharts(box, result, rows) {
  const played = rows.filter(isPlayed);
  replace(box, [reasons(result, rows), courses(result, played), endings(result, played),
    times(played, kindOf), distributions(result, played)].flat().filter((chart) => chart));
}

// The charts of all episodes together, for a summary that has come.
export function drawSummary(box, summary, total) {
  replace(box, summaryCharts(summary, total));
}
