// A submission: how it stands, and, once episodes have ended, how they did.
import {get, pause, persist} from "./api.js";
import {comparison} from "./comparison.js";
import {TIMES} from "./details.js";
import {facts, h, href, replace, table} from "./dom.js";
import {showEpisode} from "./episode.js";
import {briefly, duration, measure, name, state, time, visible, whole} from "./format.js";
import {kindOf, makeGrid} from "./grid.js";
import {liveBadge} from "./live.js";
import {boardAddress, phaseTitles, rankedRows} from "./places.js";
import {addOutput, drawCharts, drawFigures, drawSummary, highlights} from "./result.js";

const FINAL = ["done", "failed", "cancelled", "grader_error"];
const REFRESH_MS = 3000;
// What the grid and the charts need of each episode; the rest is asked for of one at a time.
const FIELDS = ["outcome", "reason", "sim_time_s", "metrics", "facts.course", "facts.peak_force",
  ...Object.keys(TIMES).map((key) => `details.${key}`)];

function statusFacts(status, titleOf) {
  const running = !FINAL.includes(status.state);
  return facts([
    ["State", state(status.state)],
    ["Team", h("a", {href: href("/team", {name: status.team})}, name(status.team))],
    ["For", h("a", {href: href("/board", board(status))}, status.phase ? titleOf(status)
      : visible(`${status.track}, rules ${status.profile}`))],
    ["Kind", status.ranked ? "ranked" : "practice"],
    ["Handed in", time(status.accepted_at)],
    status.finished_at ? ["Ended", time(status.finished_at)] : null,
    status.started_at ? ["Played for", duration(status.running_wall_s)] : null,
    running && status.queue ? ["Place in the queue", `${whole(status.queue.position)}, with `
      + `${whole(status.queue.blocks_ahead)} blocks of episodes before it`] : null,
    running && status.estimated_end_at ? ["Ends about", time(status.estimated_end_at)] : null,
  ]);
}

function drawStatus(box, status, titleOf) {
  const {done, total} = status.episodes;
  replace(box, statusFacts(status, titleOf),
    status.waiting && h("p", {class: "notice"}, "It waits: ", visible(status.waiting)),
    status.reason && h("p", {class: "problem"}, visible(status.reason)),
    status.marks.filter((mark) => mark.set).map((mark) => h("p", {class: "notice"},
      `Marked ${mark.mark}`, mark.reason ? `: ${visible(mark.reason)}` : "")),
    !FINAL.includes(status.state) && h("p", {class: "row"},
      h("progress", {max: total, value: done, "aria-label": `${done} of ${total} episodes`}),
      h("span", null, `${whole(done)} of ${whole(total)} episodes`)));
}

const board = (status) => (status.phase ? {phase: status.phase}
  : {track: status.track, profile: status.profile});

// How far a row is from the one above it, in the number that decides between them.
function gapTo(row, above, columns) {
  if (row.band !== above.band) return visible(`; ${above.team} is a band above`);
  const metric = columns.find((column) => column.name === row.decided_by);
  if (!metric) {
    const missing = above.aggregate.successes - row.aggregate.successes;
    return missing ? `; ${whole(missing)} more successes reach rank ${above.rank}`
      : `; as many successes as rank ${above.rank}`;
  }
  const [own, theirs] = [row, above].map((one) => one.aggregate[metric.name]);
  if (typeof own !== "number" || typeof theirs !== "number") return "";
  return `; ${metric.title} ${measure(own, metric)}, rank ${above.rank} has ${measure(theirs, metric)}`;
}

// Where a ranked submission stands, as everybody may see it; null if nowhere.
async function placeOf(status) {
  if (!status.ranked || status.state !== "done") return null;
  const answer = await get(boardAddress({query: board(status)})).catch(() => null);
  const ranked = answer ? rankedRows(answer) : [];
  const at = ranked.findIndex((row) => row.submission === status.submission);
  const link = (words) => h("a", {href: href("/board", board(status))}, words);
  if (at < 0) {
    const other = ranked.find((row) => row.team === status.team);
    return other ? ["Its team stands with ", h("a", {href: href("/submission", {id: other.submission})},
      name(other.name || `submission ${other.submission}`)), ", ", link(`rank ${other.rank}`), "."] : null;
  }
  const row = ranked[at];
  const band = answer.bands.find((one) => one.band === row.band);
  return [link([h("b", {class: "rank"}, `Rank ${row.rank}`), ` of ${whole(ranked.length)}`]),
    at > 0 ? gapTo(row, ranked[at - 1], briefly(answer)) : "",
    band && h("span", {class: "quiet"}, ` (${visible(band.words)})`)];
}

// What went wrong first, with a way to it.
async function firstFault(status, rows, choose) {
  const faults = rows.filter((row) => kindOf(row) === "fault");
  if (!faults.length) return null;
  const {index, outcome} = faults[0];
  const answer = await get(`/v1/submissions/${status.submission}/result?episodes=1&first=${index}&last=${index}`
    + "&details=0");
  const fault = answer.episode_rows[0]?.fault;
  const last = fault?.stderr_tail?.trim().split("\n").at(-1);
  return h("div", {class: "problem fault-first"}, h("p", null, h("b", null, `${whole(faults.length)} of ${whole(rows.length)} `
    + `episodes ended by a fault. `), `The first, episode ${index}: ${outcome}`,
  fault?.detail ? `, ${visible(fault.detail)}` : "", "."),
  last && h("pre", {class: "one-line"}, visible(last)),
  h("p", null, h("button", {type: "button", class: "small", onclick: () => choose(index)}, `Show episode ${index}`)));
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

// Columns of the API as rows: {index, outcome, metrics, facts: {course}, ...}.
function rowsOf(columns) {
  return columns.index.map((index, place) => {
    const row = {index};
    for (const [field, values] of Object.entries(columns)) {
      const [key, inner] = field.split(".");
      if (inner === undefined) row[key] = values[place];
      else (row[key] ??= {})[inner] = values[place];
    }
    return row;
  });
}

// The parts below the status. draw(status) asks for what has changed and shows it.
function makeParts() {
  const figures = h("div");
  const looks = h("div");
  const panel = h("div", {class: "card details", "aria-live": "polite"},
    h("p", {class: "quiet"}, "Choose an episode to see all about it."));
  let now = null;  // {status, result}
  const grid = makeGrid((row) => {
    // Kept, so that Back leads to it again.
    history.replaceState(null, "", `${location.pathname}${location.search}#episode-${row.index}`);
    showEpisode(panel, now.status, now.result, row);
  });
  const fault = h("div");
  const episodes = h("section", {hidden: true}, h("h2", null, "Episodes"),
    h("div", {class: "split"}, grid.element, panel));
  const charts = h("div", {class: "part"});
  const sums = h("div", {class: "part"});
  const output = h("section", {class: "output"});
  const end = h("div");
  const compared = h("div");
  const draw = async (status) => {
    let result = null;
    if (status.episodes.done) {
      // What all episodes come to together is only asked for once they have ended.
      const query = new URLSearchParams({episodes: 1, fields: FIELDS.join(","),
        summary: FINAL.includes(status.state) ? 1 : 0});
      result = await get(`/v1/submissions/${status.submission}/result?${query}`);
      now = {status, result};
      const rows = rowsOf(result.episode_columns);
      drawFigures(figures, result);
      replace(looks, highlights(result.highlights, result.metrics, status.submission));
      episodes.hidden = !rows.length;
      grid.update(rows);
      if (panel.dataset.index === undefined) grid.choose(Number(location.hash.match(/^#episode-(\d+)$/)?.[1] ?? -1));
      replace(fault, await firstFault(status, rows, grid.choose));
      drawCharts(charts, result, rows);
      drawSummary(sums, result.details_summary, result.episodes.done);
      addOutput(output, result);
      if (rows.length && FINAL.includes(status.state) && !compared.firstChild) compared.append(comparison(status));
    }
    const open = end.firstChild?.open;
    replace(end, record(status, result));
    end.firstChild.open = Boolean(open);
  };
  return {elements: [fault, figures, looks, episodes, h("div", {class: "charts"}, charts, sums), compared, output, end],
    draw};
}

export async function show(main, query) {
  const id = query.get("id");
  if (!/^\d{1,18}$/.test(id ?? "")) {
    throw new Error("The address names no submission: it ends as in /submission?id=7.");
  }
  const titleOf = await phaseTitles();
  let status = await get(`/v1/submissions/${id}`);
  const title = status.name || `Submission ${id}`;
  document.title = `${visible(title)} – MyoGrade`;
  const live = liveBadge();
  const onTrouble = (error) => {
    if (error) live.lost(error);
    else live.on(FINAL.includes(status.state) ? null : "live");
  };
  const top = h("div", {class: "card"});
  const place = h("p", {class: "standing", hidden: true});
  const parts = makeParts();
  drawStatus(top, status, titleOf);
  replace(main, h("h1", null, name(title), " ", h("span", {class: "quiet"}, `submission ${id}`), " ",
    live.element), place, top, ...parts.elements);
  let shown = null;
  for (;;) {
    let took = 0;
    const news = `${status.episodes.done} ${status.state}`;
    if (news !== shown) {
      const begin = performance.now();
      await persist(() => parts.draw(status), onTrouble);
      placeOf(status).then((words) => {
        place.hidden = !words;
        replace(place, words ?? []);
      }, reportError);
      shown = news;
      took = performance.now() - begin;
    }
    main.dataset.ready = "yes";
    if (FINAL.includes(status.state)) return;
    // A long evaluation takes long to be asked for and drawn, and is so less often.
    await pause(Math.max(REFRESH_MS, 10 * took));
    status = await persist(() => get(`/v1/submissions/${id}`), onTrouble);
    drawStatus(top, status, titleOf);
    onTrouble(null);
  }
}
