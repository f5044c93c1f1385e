// The episodes of an evaluation as a grid, one of which can be looked at.
import {facts, h, replace} from "./dom.js";
import {duration, heading, number, measure, visible, whole} from "./format.js";

const PAGE = 500;
const SIGNS = {success: "✓", failure: "✕"};

export function kindOf(row) {
  if (row.outcome === null || row.outcome === undefined) return "withheld";
  return row.outcome in SIGNS ? row.outcome : "fault";
}

function signOf(row) {
  const kind = kindOf(row);
  return SIGNS[kind] ?? (kind === "withheld" ? "·" : "!");
}

export function verdict(row) {
  if (kindOf(row) === "withheld") return "withheld";
  return row.reason ? `${row.outcome}: ${row.reason}` : row.outcome;
}

function factPairs(values) {
  return Object.entries(values ?? {}).filter(([, value]) => typeof value !== "object")
    .map(([key, value]) => [key.replaceAll("_", " "), typeof value === "number"
      ? String(Number(value.toPrecision(6))) : String(value)]);
}

// Everything that is known of one episode.
function details(row, metrics) {
  const fault = row.fault;
  return [h("h3", null, `Episode ${row.index}: ${verdict(row)}`),
    facts([
      ["Seed", row.seed ?? "withheld"],
      ["Simulated time", row.sim_time_s === null ? "withheld" : `${number(row.sim_time_s, 2)} s`],
      ["Steps", whole(row.steps)],
      ...metrics.filter((metric) => row.metrics?.[metric.name] !== null
        && row.metrics?.[metric.name] !== undefined)
        .map((metric) => [heading({...metric, unit: ""}), measure(row.metrics[metric.name], metric)]),
      ["Clipped actions", whole(row.clipped)],
      ["Policy's CPU time", row.policy_cpu_s === null ? "–" : `${number(row.policy_cpu_s, 2)} s`],
      ["Wall time", duration(row.wall_s)],
      ["Attempt", whole(row.attempt)],
    ]),
    fault && h("div", {class: "error"}, h("p", null, h("b", null, fault.outcome), ", fault of the ",
      fault.whose, fault.limit ? `, limit ${fault.limit} = ${fault.limit_value}` : "",
      fault.value === null ? "" : `, value ${fault.value}`, fault.step === null ? ""
        : `, at step ${fault.step}`, ". ", visible(fault.detail ?? "")),
    fault.stderr_tail && h("pre", {tabindex: 0, "aria-label": "The end of its standard error"},
      visible(fault.stderr_tail))),
    row.facts && h("details", null, h("summary", null, "Facts as the simulator measured them"),
      facts(factPairs(row.facts))),
    row.digest && h("p", {class: "hash"}, "Digest of states ", h("code", null, row.digest)),
  ];
}

function cell(row, select) {
  return h("button", {type: "button", class: `cell ${kindOf(row)}`, tabindex: -1,
    "data-index": row.index, "aria-label": `Episode ${row.index}: ${verdict(row)}`,
    title: `Episode ${row.index}: ${verdict(row)}`, onclick: (event) => select(row, event.target)},
  signOf(row));
}

// Arrow keys go from cell to cell, of which one at a time can be reached by Tab.
function arrows(box, event) {
  const cells = [...box.children];
  const place = cells.indexOf(document.activeElement);
  if (place < 0) return;
  const columns = cells.filter((one) => one.offsetTop === cells[0].offsetTop).length;
  const steps = {ArrowRight: 1, ArrowLeft: -1, ArrowDown: columns, ArrowUp: -columns,
    Home: -place, End: cells.length - 1 - place};
  if (!(event.key in steps)) return;
  event.preventDefault();
  const next = cells[Math.min(Math.max(place + steps[event.key], 0), cells.length - 1)];
  document.activeElement.tabIndex = -1;
  next.tabIndex = 0;
  next.focus();
}

function legend(rows) {
  const kinds = [["success", "success"], ["failure", "failure"], ["fault", "participant's fault"],
    ["withheld", "withheld by the phase"]];
  const sign = {...SIGNS, fault: "!", withheld: "·"};
  return h("ul", {class: "legend"}, kinds.map(([kind, words]) => [kind, words,
    rows.filter((row) => kindOf(row) === kind).length]).filter(([, , count]) => count)
    .map(([kind, words, count]) => h("li", null, h("span", {class: `cell ${kind}`,
      "aria-hidden": "true"}, sign[kind]), ` ${words}: ${whole(count)}`)));
}

export function grid(rows, metrics) {
  const panel = h("div", {class: "card details", "aria-live": "polite"},
    h("p", {class: "quiet"}, "Choose an episode to see all about it."));
  const box = h("div", {class: "grid", role: "group", "aria-label": "Episodes",
    onkeydown: (event) => arrows(box, event)});
  const select = (row, button) => {
    for (const one of box.querySelectorAll("[aria-pressed]")) one.removeAttribute("aria-pressed");
    button.setAttribute("aria-pressed", "true");
    replace(panel, details(row, metrics));
  };
  const place = h("span", {role: "status"});
  let first = 0;
  const draw = () => {
    const page = rows.slice(first, first + PAGE);
    replace(box, page.map((row) => cell(row, select)));
    if (box.firstChild) box.firstChild.tabIndex = 0;
    place.textContent = page.length ? `Episodes ${page[0].index} to ${page.at(-1).index}` : "";
  };
  const turn = (by) => {
    first = Math.min(Math.max(first + by, 0), Math.floor((rows.length - 1) / PAGE) * PAGE);
    draw();
  };
  draw();
  return h("div", null, legend(rows), rows.length > PAGE && h("p", {class: "row"},
    h("button", {type: "button", onclick: () => turn(-PAGE)}, "Before"), place,
    h("button", {type: "button", onclick: () => turn(PAGE)}, "Next")),
  h("div", {class: "split"}, box, panel));
}

