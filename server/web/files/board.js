// One board: its columns, groups and baselines, and why one stands above another.
import {get, whoami, isOrganiser} from "./api.js";
import {boardTitle} from "./boards.js";
import {h, href, replace, table} from "./dom.js";
import {heading, name, number, percent, time, visible, whole} from "./format.js";

const ASKED = ["track", "phase", "profile", "board", "config", "at"];

// The part of the address that says which board is meant, with `changes`.
function boardQuery(query, changes = {}) {
  const own = Object.fromEntries(ASKED.filter((key) => query.get(key))
    .map((key) => [key, query.get(key)]));
  return {...own, ...changes};
}

function api(path, query, more = {}) {
  return `${path}?${new URLSearchParams({...boardQuery(query), ...more})}`;
}

function probability(value) {
  return value < 0.001 ? "p < 0.001" : `p = ${number(value, 3)}`;
}

// What the paired test says of a row and the one above it.
function testSentence(test, criteria) {
  if (!test) return null;
  if (test.metric === null || test.p === null) return null;
  const title = criteria.find((one) => one.name === test.metric)?.title ?? test.metric;
  const verdict = test.decided ? "The episodes decide this place"
    : "The episodes do not decide this place";
  return `${verdict}: paired test of ${title} over ${whole(test.pairs)} episodes, of which `
    + `${whole(test.differing)} differ; ${probability(test.p)}, corrected for all tests `
    + `${probability(test.p_adjusted)}.`
    + (test.reversed ? " With the further episodes the lower one is better." : "");
}

async function explain(cell, query, above, row, test, criteria) {
  replace(cell, h("p", {role: "status"}, "Loading…"));
  try {
    const answer = await get(api("/v1/leaderboard/explain", query,
      {a: above.submission, b: row.submission}));
    replace(cell, h("p", null, visible(answer.why)), h("p", {class: "quiet"},
      testSentence(test, criteria)));
  } catch (error) {
    replace(cell, h("p", {class: "problem"}, visible(error.message)));
  }
}

function whyButton(query, above, row, test, criteria, span) {
  const cell = h("td", {colspan: span, class: "why"});
  const more = h("tr", {hidden: true, id: `why-${row.submission}`}, cell);
  const button = h("button", {type: "button", class: "small", "aria-expanded": "false",
    "aria-controls": more.id, "aria-label": `Why ${visible(above.team)} stands above `
    + visible(row.team),
    onclick: () => {
      more.hidden = !more.hidden;
      button.setAttribute("aria-expanded", String(!more.hidden));
      if (!more.hidden && !cell.childNodes.length) explain(cell, query, above, row, test, criteria);
    }}, "Why?");
  return [button, more];
}

function tags(row) {
  return [
    row.baseline && h("span", {class: "tag"}, "baseline"),
    row.qualified && h("span", {class: "tag good", title: "At or above the board's line"},
      "qualified"),
    row.rejudge && h("span", {class: "tag", title: `Result of rejudge ${row.rejudge}`}, "rejudged"),
    row.other_build && h("span", {class: "tag", title: `Graded by build ${row.build}`},
      "other build"),
  ];
}

function interval(known, metric) {
  if (!known || known.low === null || known.low === undefined) return null;
  const scale = metric ? 1 : 100;
  const digits = metric ? metric.digits : 0;
  return h("span", {class: "interval", title: `95 % interval (${known.method})`},
    `${number(known.low * scale, digits)} to ${number(known.high * scale, digits)}`);
}

function successCell(row, intervals) {
  const {successes, episodes} = row.aggregate ?? {};
  if (successes === undefined || successes === null) return h("td", {class: "num"}, "–");
  return h("td", {class: "num"},
    h("span", {class: "value"}, percent(successes, episodes)),
    h("meter", {min: 0, max: episodes, value: successes, "aria-label":
      `${successes} of ${episodes} episodes`}),
    interval(intervals?.success_rate, null));
}


// The rows of a board's table: each with the row that tells why it stands below the one above.
function boardRows(board, statistics, query, mayRead) {
  const known = new Map((statistics?.rows ?? []).map((row) => [row.submission, row]));
  const criteria = statistics?.criteria ?? [];
  const groups = (statistics?.groups ?? []).some((group) => group.rows > 1);
  const span = board.columns.length + 4 + (groups ? 1 : 0);
  let above = null;
  let group = null;
  const rows = [];
  for (const row of board.rows) {
    const more = known.get(row.submission);
    const [button, why] = above ? whyButton(query, above, row, more?.above, criteria, span)
      : [null, null];
    const newGroup = groups && more?.group && more.group !== group;
    if (more?.group) group = more.group;
    const submission = row.name ? name(row.name) : `submission ${row.submission}`;
    rows.push(h("tr", {class: [row.baseline ? "baseline" : "", newGroup ? "opens" : ""].join(" ")},
      h("td", {class: "num place"}, row.rank === null ? "–" : row.rank),
      groups && h("td", {class: `group ${(more?.group ?? 0) % 2 ? "odd" : "even"}`},
        more?.group ?? "–"),
      h("th", {scope: "row"}, h("a", {href: href("/team", {name: row.team})}, name(row.team)),
        tags(row), h("span", {class: "policy"}, mayRead(row.team)
          ? h("a", {href: href("/submission", {id: row.submission})}, submission) : submission)),
      successCell(row, more?.intervals),
      board.columns.map((column) => h("td", {class: "num"},
        h("span", {class: "value"}, number(row.aggregate?.[column.name], column.digits)),
        interval(more?.intervals?.[column.name], column))),
      h("td", {class: "ask"}, button)));
    if (why) rows.push(why);
    if (!row.baseline || above === null) above = row;
  }
  return [rows, groups];
}

function boardTable(board, statistics, query, mayRead) {
  const [rows, groups] = boardRows(board, statistics, query, mayRead);
  const arrow = {less: " ↓", more: " ↑", neither: ""};
  const heads = [h("th", {scope: "col", class: "num"}, "Rank"),
    groups && h("th", {scope: "col", class: "group"}, "Group"),
    "Team and policy", h("th", {scope: "col", class: "num"}, "Success ↑"),
    ...board.columns.map((column) => h("th", {scope: "col", class: "num",
      title: {less: "less is better", more: "more is better", neither: "not ranked"}[column.better]},
    heading(column) + arrow[column.better])),
    h("th", {scope: "col"}, h("span", {class: "hidden"}, "Why it stands here"))].filter((x) => x);
  return table(`${boardTitle(board.board)} of ${board.phase ?? board.track}`, heads, rows,
    {class: "board"});
}

function disqualified(board) {
  if (!board.disqualified.length) return null;
  return h("section", null, h("h2", null, "Disqualified"),
    table("Disqualified submissions", ["Team", "Policy", "Reason", "When"],
      board.disqualified.map((row) => h("tr", null, h("th", {scope: "row"}, name(row.team)),
        h("td", null, name(row.name)), h("td", null, visible(row.reason)),
        h("td", null, time(row.at))))));
}

function tabs(boards, board, query) {
  if (boards.length < 2) return null;
  return h("nav", {class: "tabs", "aria-label": "Boards"}, h("ul", null, boards.map((one) =>
    h("li", null, h("a", {href: href("/board", boardQuery(query, {board: one})),
      "aria-current": one === board.board ? "page" : null}, boardTitle(one))))));
}

function notices(board) {
  const past = board.at ? ["As it was ", time(board.at), ". "] : null;
  const frozen = board.frozen_at ? ["Frozen since ", time(board.frozen_at),
    board.complete ? " for everybody but organisers: you see all of it. "
      : ": what ended later is shown once the phase is published. "] : null;
  const other = board.config !== board.config_in_force
    ? "This board is under a config that is not in force any more. " : null;
  const text = [past, frozen, other].filter((one) => one);
  return text.length ? h("p", {class: "notice"}, text) : null;
}

function otherBoards(board, query) {
  const others = board.other_configs ?? [];
  const at = h("input", {type: "datetime-local", id: "at", step: 1});
  return h("details", {class: "more"}, h("summary", null, "Feed, past boards and other configs"),
    h("form", {class: "row", onsubmit: (event) => {
      event.preventDefault();
      if (!at.value) return;
      location.assign(href("/board", boardQuery(query, {at: new Date(at.value).toISOString()})));
    }}, h("label", {for: "at"}, "The board at"), at, h("button", {type: "submit"}, "Show"),
    query.get("at") && h("a", {href: href("/board", boardQuery(query, {at: ""}))}, "Show today's")),
    h("p", null, h("a", {href: api("/v1/leaderboard/feed", query)}, "Feed of this board (Atom)"),
      ", ", h("a", {href: api("/v1/leaderboard", query)}, "the same as JSON")),
    others.length > 0 && h("ul", null, others.map((other) => h("li", null,
      h("a", {href: href("/board", boardQuery(query, {config: other.config}))},
        `Config ${other.config.slice(0, 12)}`),
      `: ${other.submissions} submissions of ${other.teams} teams, from `, time(other.from), " to ",
      time(other.to)))));
}

export async function show(main, query) {
  const address = api("/v1/leaderboard", query);
  const [board, {tracks}, who] = await Promise.all([get(address), get("/v1/tracks"), whoami()]);
  const title = board.phase ? `Phase ${board.phase}` : board.track;
  document.title = `${title}: ${boardTitle(board.board)} – MyoGrade`;
  const boards = tracks.find((track) => track.track === board.track)?.boards ?? [board.board];
  const mayRead = (team) => isOrganiser(who) || who.teams.includes(team);
  const box = h("div");
  const draw = (statistics) => replace(box, board.rows.length
    ? boardTable(board, statistics, query, mayRead)
    : h("p", {class: "empty"}, "Nobody is ranked on this board yet."));
  draw(null);
  replace(main, h("h1", null, title), tabs(boards, board, query),
    h("p", {class: "lead"}, `${whole(board.episodes)} episodes, rules `, h("b", null, board.profile),
      ". ", board.order),
    notices(board), box, disqualified(board), otherBoards(board, query),
    board.unreadable?.length > 0 && h("p", {class: "problem"},
      `${board.unreadable.length} results can't be read and are left out.`));
  if (board.rows.length > 1) {
    const statistics = await get(api("/v1/leaderboard/statistics", query)).catch(() => null);
    if (statistics) {
      draw(statistics);
      if (statistics.undecided) {
        box.append(h("p", {class: "quiet"}, `Of the first ${statistics.statistics.places} places the `
          + `episodes leave ${statistics.undecided} undecided at the level `
          + `${statistics.statistics.level}.`));
      }
    }
  }
}
