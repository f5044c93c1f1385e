// The first page: every board that there is, with its leaders.
import {get} from "./api.js";
import {h, href, replace} from "./dom.js";
import {heading, measure, name, percent, time, visible} from "./format.js";

const SHOWN = 3;
const TITLES = {main: "Main board", physiological: "Physiological board"};

export function boardTitle(board) {
  return TITLES[board] ?? board;
}

function leader(row, columns) {
  const first = columns[0];
  const value = row.aggregate?.[first?.name];
  return h("li", null,
    h("span", {class: "rank"}, row.rank === null ? "–" : row.rank),
    h("span", {class: "who-leads"}, h("a", {href: href("/team", {name: row.team})}, name(row.team)),
      row.baseline && h("span", {class: "tag"}, "baseline")),
    h("span", {class: "figure"}, first ? measure(value, first)
      : percent(row.aggregate?.successes, row.aggregate?.episodes)));
}

async function fillLeaders(box, query) {
  try {
    const board = await get(`/v1/leaderboard?${new URLSearchParams(query)}`);
    if (!board.rows.length) {
      replace(box, h("p", {class: "quiet"}, "Nobody is ranked yet."));
      return;
    }
    const first = board.columns[0];
    replace(box,
      h("p", {class: "quiet"}, `${board.rows.length} ${board.rows.length === 1 ? "entry" : "entries"}`,
        first ? `, with ${heading(first).toLowerCase()}` : ", with successes"),
      h("ol", {class: "leaders"}, board.rows.slice(0, SHOWN).map((row) =>
        leader(row, board.columns))));
  } catch (error) {
    replace(box, h("p", {class: "problem"}, visible(error.message)));
  }
}

// A card of a phase or of a track, with links to its boards. What it still has to ask for goes to
// `waiting`.
function card(title, lines, query, boards, waiting) {
  const box = h("div", {class: "leaders-box"}, h("p", {class: "quiet"}, "Loading…"));
  waiting.push(fillLeaders(box, query));
  return h("section", {class: "card"},
    h("h3", null, h("a", {href: href("/board", query)}, title)), lines, box,
    boards.length > 1 && h("p", {class: "links"}, boards.map((board) =>
      h("a", {href: href("/board", {...query, board})}, boardTitle(board)))));
}

function phaseLines(phase) {
  const when = phase.state === "upcoming" ? ["opens ", time(phase.opens_at)]
    : phase.closes_at ? [phase.state === "closed" ? "closed " : "closes ", time(phase.closes_at)]
      : [];
  return [
    h("p", null, h("span", {class: `state ${phase.state}`}, phase.state),
      when.length ? [" ", ...when] : null),
    phase.paused && h("p", {class: "problem"}, "Paused: ", visible(phase.paused.reason)),
    phase.frozen && !phase.published && h("p", {class: "quiet"},
      "The board is frozen until the results are published."),
  ];
}

function boardsOf(tracks, track) {
  return tracks.find((one) => one.track === track)?.boards ?? ["main"];
}

export async function show(main) {
  document.title = "Boards – MyoGrade";
  const [{tracks}, all] = await Promise.all([get("/v1/tracks"), get("/v1/challenges")]);
  const ofPhases = new Set();
  const waiting = [];
  const sections = all.challenges.map((challenge) => h("section", null,
    h("h2", null, visible(challenge.title ?? challenge.challenge)),
    h("div", {class: "cards"}, challenge.phases.map((phase) => {
      ofPhases.add(phase.track);
      return card(visible(phase.title), phaseLines(phase), {phase: phase.phase},
        boardsOf(tracks, phase.track), waiting);
    }))));
  const former = all.former_phases.map((phase) => card(phase.phase,
    [h("p", null, h("span", {class: "state closed"}, "former"))], {phase: phase.phase},
    boardsOf(tracks, phase.track), waiting));
  const open = tracks.filter((track) => !ofPhases.has(track.track));
  replace(main, h("h1", null, "Boards"),
    all.paused && h("p", {class: "notice"}, "Submissions are paused: ", visible(all.paused.reason)),
    sections,
    open.length > 0 && h("section", null, h("h2", null, "Tracks"), h("div", {class: "cards"},
      open.map((track) => card(track.track, [], {track: track.track}, track.boards, waiting)))),
    former.length > 0 && h("section", null, h("h2", null, "Former phases"),
      h("div", {class: "cards"}, former)));
  await Promise.all(waiting);
}
