// One board, which stays current while it is open.
import {get, isOrganiser, passes, pause, whoami} from "./api.js";
import {BoardTable} from "./board_table.js";
import {h, href, replace, table} from "./dom.js";
import {boardTitle, dateTime, name, time, visible, whole} from "./format.js";
import {liveBadge} from "./live.js";
import {phaseWhen} from "./places.js";
import {asCsv, asTsv, copyText, save, textsOf} from "./sheet.js";

const ASKED = ["track", "phase", "profile", "board", "config", "at"];
const REFRESH_MS = 30000;
const PHASE_EVERY = 10;  // refreshes

// The part of the address that says which board is meant, with `changes`.
function boardQuery(query, changes = {}) {
  const own = Object.fromEntries(ASKED.filter((key) => query.get(key))
    .map((key) => [key, query.get(key)]));
  return {...own, ...changes};
}

function api(path, query, more = {}) {
  return `${path}?${new URLSearchParams({...boardQuery(query), ...more})}`;
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
  const past = board.at ? ["As it was ", time(board.at), ", ", dateTime(board.at), ". "] : null;
  const frozen = board.frozen_at ? ["Frozen since ", dateTime(board.frozen_at),
    board.complete ? " for everybody but organisers: you see all of it. "
      : ": what ended later is shown once the phase is published. "] : null;
  const other = board.config !== board.config_in_force
    ? "This board is under a config that is no longer in force. " : null;
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

// What can be done with the table; `mine`: whether the reader's team is on it.
function tools(rows, file, mine, asOf) {
  const sheet = () => textsOf(rows.element.querySelector("table"));
  const mark = h("input", {type: "checkbox", id: "mark"});
  const said = h("span", {class: "quiet", role: "status"});
  return h("div", {class: "row tools"},
    h("input", {type: "search", class: "filter", placeholder: "Filter", "aria-label":
      "Show only teams and policies with these letters", oninput: (event) => rows.filter(event.target.value)}),
    mine && h("button", {type: "button", onclick: () => rows.find()}, "My team"),
    h("button", {type: "button", onclick: () => copyText(asTsv(sheet())).then((done) => {
      said.textContent = done ? "Copied: paste it into a spreadsheet." : "This browser does not let pages copy.";
    })}, "Copy"),
    h("button", {type: "button", onclick: () => save(asCsv(sheet(), mark.checked), `${file}.csv`,
      "text/csv;charset=utf-8")}, "CSV"),
    h("label", {class: "inline", for: "mark", title: "Some spreadsheets need it to read names rightly"}, mark,
      " with UTF-8 mark"), said, asOf);
}

function undecided(statistics) {
  if (!statistics?.undecided) return null;
  return `These episodes don't tell the teams of one group apart: of the first ${statistics.statistics.places} `
    + `places ${statistics.undecided} are undecided (level ${statistics.statistics.level}).`;
}

// The phase of a board as the API tells of it, with its challenge's title; null: of none that a file describes.
async function phaseOf(board) {
  if (!board.phase) return null;
  const {challenges} = await get("/v1/challenges");
  for (const challenge of challenges) {
    const phase = challenge.phases.find((one) => one.phase === board.phase);
    if (phase) return {...phase, challenge: challenge.title ?? challenge.challenge};
  }
  return null;
}

// Asks again and again, as long as somebody sees the page; redraw(board) is called with what has changed.
async function keepCurrent(address, first, live, asOf, redraw) {
  let text = JSON.stringify(first);
  for (let count = 1; ; count += 1) {
    await pause(REFRESH_MS);
    if (document.hidden) continue;
    try {
      const board = await get(address);
      const now = JSON.stringify(board);
      if (now !== text || count % PHASE_EVERY === 0) await redraw(board, now !== text);
      text = now;
      live.on("live");
      replace(asOf, "As of ", new Date().toLocaleTimeString("en-GB"));
    } catch (error) {
      if (!passes(error)) throw error;
      live.lost(error);
    }
  }
}

export async function show(main, query) {
  const address = api("/v1/leaderboard", query);
  const [board, {tracks}, who] = await Promise.all([get(address), get("/v1/tracks"), whoami()]);
  const phase = await phaseOf(board);
  const title = phase?.title ?? (board.phase ? `Phase ${board.phase}` : board.track);
  document.title = `${visible(title)}: ${boardTitle(board.board)} – MyoGrade`;
  const boards = tracks.find((track) => track.track === board.track)?.boards ?? [board.board];
  const isMine = (team) => who.teams.includes(team);
  const rows = new BoardTable({isMine, mayRead: (team) => isOrganiser(who) || isMine(team),
    label: `${boardTitle(board.board)} of ${visible(title)}`,
    explain: (above, below) => api("/v1/leaderboard/explain", query, {a: above.submission, b: below.submission})});
  const live = liveBadge();
  const asOf = h("span", {class: "quiet as-of"}, `As of ${new Date().toLocaleTimeString("en-GB")}`);
  const [when, warnings, told, rest] = [0, 1, 2, 3].map(() => h("div"));
  const box = h("div");
  let statistics = null;
  const draw = async (answer, of, changed = true) => {
    replace(when, of && phaseWhen(of));
    if (!changed) return;
    replace(warnings, notices(answer));
    replace(rest, disqualified(answer), otherBoards(answer, query), answer.unreadable?.length > 0
      && h("p", {class: "problem"}, `${answer.unreadable.length} results can't be read and are left out.`));
    rows.show(answer, statistics);
    replace(box, answer.rows.length ? [tools(rows, `${answer.phase ?? answer.track}-${answer.board}`,
      answer.rows.some((row) => isMine(row.team)), asOf), rows.element]
      : h("p", {class: "empty"}, "Nobody is ranked on this board yet."));
    if (answer.rows.length < 2) return;
    statistics = await get(api("/v1/leaderboard/statistics", query)).catch(() => null);
    if (statistics) rows.show(answer, statistics);
    replace(told, statistics && h("p", {class: "quiet"}, undecided(statistics)));
  };
  replace(main, phase && h("p", {class: "over-title"}, h("a", {href: "/"}, visible(phase.challenge))),
    h("h1", null, visible(title), " ", live.element), when, tabs(boards, board, query),
    h("p", {class: "lead"}, `${whole(board.episodes)} episodes, rules `, h("b", null, board.profile),
      ". ", board.order), warnings, box, told, rest);
  await draw(board, phase);
  if (board.at) return;
  live.on("live");
  // The page is there; this goes on for as long as it is open, or ends with what asking again won't mend.
  keepCurrent(address, board, live, asOf, async (answer, changed) => draw(answer, await phaseOf(answer), changed))
    .catch(live.lost);
}
