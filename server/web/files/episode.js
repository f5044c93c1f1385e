// All about one episode of a submission: its figures, a picture, and ways to look at it in motion.
import {get} from "./api.js";
import {facts, h, replace} from "./dom.js";
import {duration, heading, measure, number, visible, whole} from "./format.js";
import {verdict} from "./grid.js";
import {picture} from "./pictures.js";
import {filesOf, leadersEpisode, replayAddress} from "./replays.js";

function flat(values, path = "") {
  return Object.entries(values ?? {}).flatMap(([key, value]) => {
    if (Array.isArray(value)) return [];
    if (value !== null && typeof value === "object") return flat(value, `${path}${key} `);
    return [[`${path}${key}`.replaceAll("_", " "), typeof value === "number"
      ? String(Number(value.toPrecision(6))) : String(value ?? "–")]];
  });
}

function figures(row, metrics) {
  const known = metrics.filter((metric) => row.metrics?.[metric.name] !== null
    && row.metrics?.[metric.name] !== undefined);
  return facts([
    ["Seed", row.seed ?? "withheld"],
    ["Simulated time", row.sim_time_s === null ? "withheld" : `${number(row.sim_time_s, 2)} s`],
    ["Steps", whole(row.steps)],
    ...known.map((metric) => [heading({...metric, unit: ""}),
      measure(row.metrics[metric.name], metric)]),
    ["Clipped actions", whole(row.clipped)],
    ["Policy's CPU time", row.policy_cpu_s === null ? "–" : `${number(row.policy_cpu_s, 2)} s`],
    ["Wall time", duration(row.wall_s)],
    ["Attempt", whole(row.attempt)],
  ]);
}

// What was measured of a fault; of a program that ended, how.
function valueWords({outcome, value}) {
  if (value === null || value === undefined) return "";
  if (outcome !== "crash" || !Number.isInteger(value)) return `, value ${value}`;
  return value & 127 ? `, ended by signal ${value & 127}` : `, exit status ${value >> 8}`;
}

function faultBox(fault) {
  if (!fault) return null;
  return h("div", {class: "error"}, h("p", null, h("b", null, fault.outcome), ", fault of the ",
    fault.whose, fault.limit ? `, limit ${fault.limit} = ${fault.limit_value}` : "",
    valueWords(fault), fault.step === null ? ""
      : `, at step ${fault.step}`, ". ", visible(fault.detail ?? "")),
  fault.stderr_tail && h("pre", {tabindex: 0, "aria-label": "The end of its standard error"},
    visible(fault.stderr_tail)));
}

// Links to the episode in motion: alone, and beside the leader's.
function motion(status, result, row) {
  if (!row.log) return null;
  const own = {log: row.log.sha256, of: status.submission};
  const links = h("p", {class: "row"}, h("a", {class: "button main", href: replayAddress(own)},
    "Replay"));
  leadersEpisode(status, result, row.index).then((theirs) => {
    if (theirs) {
      links.append(h("a", {class: "button", href: replayAddress(own, theirs)},
        "Compare with the leader"));
    }
  });
  return links;
}

// Fills a panel with what is known of an episode. `row` has its index and verdict; the rest is asked for.
export async function showEpisode(panel, status, result, brief) {
  const title = `Episode ${brief.index}: ${verdict(brief)}`;
  panel.dataset.index = brief.index;
  replace(panel, h("h3", null, title), h("p", {class: "quiet"}, "Loading…"));
  const address = `/v1/submissions/${status.submission}/result?episodes=1&first=${brief.index}`
    + `&last=${brief.index}`;
  let row;
  try {
    [row] = (await get(address)).episode_rows;
  } catch (error) {
    replace(panel, h("h3", null, title), h("p", {class: "problem"}, visible(error.message)));
    return;
  }
  if (panel.dataset.index !== String(brief.index)) return;  // another one was chosen meanwhile
  replace(panel, h("h3", null, title),
    row.log && picture(filesOf(row.log.sha256), `A moment of episode ${row.index}, ${verdict(row)}`),
    motion(status, result, row), figures(row, result.metrics), faultBox(row.fault),
    row.facts && h("details", null, h("summary", null, "Facts as the simulator measured them"),
      facts(flat(row.facts))),
    row.details && h("details", null, h("summary", null, "Details"), facts(flat(row.details))),
    row.digest && h("p", {class: "hash"}, "Digest of states ", h("code", null, row.digest)));
}
