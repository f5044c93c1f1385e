// A submission: how it stands, and, once episodes have ended, how they did.
import {get} from "./api.js";
import {histogram, shares, strips} from "./charts.js";
import {facts, h, href, replace, table} from "./dom.js";
import {bytes, duration, heading, measure, name, number, percent, state, time, visible, whole}
  from "./format.js";
import {grid, kindOf} from "./grid.js";

const FINAL = ["done", "failed", "cancelled", "grader_error"];
const REFRESH_MS = 3000;
const COURSES = ["flat", "hilly", "rough", "stairs", "mixed"];
const FORCE = {name: "peak_force", title: "peak force", unit: "N", digits: 1};

function statusFacts(status) {
  const running = !FINAL.includes(status.state);
  return facts([
    ["State", state(status.state)],
    ["Team", h("a", {href: href("/team", {name: status.team})}, name(status.team))],
    ["For", h("a", {href: status.phase ? href("/board", {phase: status.phase})
      : href("/board", {track: status.track, profile: status.profile})},
    visible(status.phase ?? `${status.track}, rules ${status.profile}`))],
    ["Kind", status.ranked ? "ranked" : "practice"],
    ["Handed in", time(status.accepted_at)],
    status.finished_at ? ["Ended", time(status.finished_at)] : null,
    status.started_at ? ["Played for", duration(status.running_wall_s)] : null,
    running && status.queue ? ["Place in the queue", `${whole(status.queue.position)}, with `
      + `${whole(status.queue.leases_ahead)} blocks of episodes before it`] : null,
    running && status.estimated_end_at ? ["Ends about", time(status.estimated_end_at)] : null,
  ]);
}

function drawStatus(box, status) {
  const {done, total} = status.episodes;
  replace(box, statusFacts(status),
    status.waiting && h("p", {class: "notice"}, "It waits: ", visible(status.waiting)),
    status.reason && h("p", {class: "problem"}, visible(status.reason)),
    status.marks.filter((mark) => mark.set).map((mark) => h("p", {class: "notice"},
      `Marked ${mark.mark}`, mark.reason ? `: ${visible(mark.reason)}` : "")),
    !FINAL.includes(status.state) && h("p", {class: "row"},
      h("progress", {max: total, value: done, "aria-label": `${done} of ${total} episodes`}),
      h("span", null, `${whole(done)} of ${whole(total)} episodes`)));
}

function tile(title, value, more) {
  return h("div", {class: "tile"}, h("dt", null, title), h("dd", null, h("b", null, value),
    more && h("span", {class: "interval"}, more)));
}

function spread(aggregate, metric) {
  const known = aggregate.spread?.[metric.name];
  if (!known || known.low === null || known.low === undefined) return null;
  return `95 %: ${number(known.low, metric.digits)} to ${number(known.high, metric.digits)}`;
}

function tiles(result) {
  const all = result.aggregate;
  if (!all) return null;
  return h("dl", {class: "tiles"},
    tile("Success", percent(all.successes, all.episodes),
      `${whole(all.successes)} of ${whole(all.episodes)} episodes`),
    result.metrics.filter((metric) => typeof all[metric.name] === "number"
      && metric.name !== "success_rate").map((metric) =>
      tile(heading({...metric, unit: ""}), measure(all[metric.name], metric),
        spread(all, metric))));
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

function output(result) {
  if (!result.output?.length) return null;
  return h("section", null, h("h2", null, "Output"), result.output.map((lease) =>
    h("details", {class: "card"}, h("summary", null, `Episodes ${lease.first} to ${lease.last}: `
      + `${number(lease.policy_cpu_s, 1)} s of CPU time, ${bytes(lease.peak_memory_bytes)} of memory`),
    stream("Standard output", lease.stdout_tail, lease.stdout_truncated),
    stream("Standard error", lease.stderr_tail, lease.stderr_truncated),
    !lease.stdout_tail && !lease.stderr_tail && h("p", {class: "quiet"}, "It printed nothing."))));
}

function drawResult(box, result) {
  const rows = result.episode_rows ?? [];
  replace(box,
    result.withheld?.length > 0 && h("p", {class: "notice"}, "The phase withholds until it is "
      + `published: ${result.withheld.join(", ")}.`),
    result.not_repeatable?.length > 0 && h("p", {class: "problem"},
      `${result.not_repeatable.length} episodes had another result when they were played again.`),
    tiles(result),
    rows.length > 0 && h("section", null, h("h2", null, "Episodes"), grid(rows, result.metrics)),
    h("div", {class: "charts"}, [reasons(result, rows), courses(result, rows),
      endings(result, rows), distributions(result, rows)].flat().filter((chart) => chart)),
    output(result));
}

function record(status, result) {
  return h("details", {class: "more"}, h("summary", null, "Hashes and history"),
    facts([["Artefact", h("code", null, status.artefact)],
      ...Object.entries(result?.hashes ?? {}).filter(([key]) => key !== "artefact")
        .map(([key, value]) => [key, h("code", null, value)]),
      result?.merkle_root ? ["Merkle root", h("code", null, result.merkle_root)] : null,
      result?.grader ? ["Grader", `${result.grader.version}`] : null]),
    table("History", ["When", "What", "To", "By", "Why"], status.history.map((change) =>
      h("tr", null, h("td", null, time(change.at)), h("td", null, change.of),
        h("td", null, change.to), h("td", null, change.who),
        h("td", {class: "wide"}, visible(change.why ?? ""))))));
}

const pause = () => new Promise((resolve) => {
  setTimeout(resolve, REFRESH_MS);
});

export async function show(main, query) {
  const id = query.get("id");
  if (!/^\d{1,18}$/.test(id ?? "")) {
    throw new Error("The address names no submission: it ends as in /submission?id=7.");
  }
  let status = await get(`/v1/submissions/${id}`);
  const title = status.name || `Submission ${id}`;
  document.title = `${visible(title)} – MyoGrade`;
  const top = h("div", {class: "card"});
  const box = h("div");
  const end = h("div");
  drawStatus(top, status);
  replace(main, h("h1", null, name(title), " ", h("span", {class: "quiet"}, `submission ${id}`)),
    top, box, end);
  let shown = -1;
  for (;;) {
    if (status.episodes.done !== shown) {
      shown = status.episodes.done;
      const result = shown ? await get(`/v1/submissions/${id}/result?episodes=1`)
        : null;
      if (result) drawResult(box, result);
      replace(end, record(status, result));
    }
    main.dataset.ready = "yes";
    if (FINAL.includes(status.state)) return;
    await pause();
    status = await get(`/v1/submissions/${id}`);
    drawStatus(top, status);
  }
}
