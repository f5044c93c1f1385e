// Which other submission's episode can be shown beside one, as far as the reader may see it.
import {get} from "./api.js";
import {h, href} from "./dom.js";
import {visible} from "./format.js";

const MOST = 100;

function logOf(row) {
  return row.log?.sha256 ?? row.log ?? null;
}

async function rowOf(submission, fits) {
  const result = await get(`/v1/submissions/${submission}/result?episodes=1`);
  return (result.episode_rows ?? []).find(fits) ?? null;
}

function nameOf(status) {
  return `${status.team}: ${status.name || `submission ${status.submission}`}`;
}

// Other submissions that were played as this one was, those of its board's leaders first.
async function others(own) {
  const list = await get(href("/v1/submissions", {track: own.track, phase: own.phase, limit: MOST}));
  const board = await get(href("/v1/leaderboard", own.phase ? {phase: own.phase}
    : {track: own.track, profile: own.profile})).catch(() => ({rows: []}));
  const ranks = new Map(board.rows.map((row) => [row.submission, row.rank]));
  return list.submissions.filter((one) => one.submission !== own.submission && one.episodes.done > 0)
    .map((one) => ({...one, rank: ranks.get(one.submission) ?? Infinity}))
    .sort((a, b) => a.rank - b.rank || b.submission - a.submission);
}

// The log of the episode with the same seed, or, where seeds are withheld, with the same number.
async function sameEpisode(own, log, other) {
  const mine = await rowOf(own.submission, (row) => logOf(row) === log);
  if (!mine) throw new Error("This submission has no such episode any more.");
  const same = mine.seed === null || mine.seed === undefined
    ? (row) => row.index === mine.index : (row) => row.seed === mine.seed;
  const row = await rowOf(other, same);
  if (!row) throw new Error("The other submission has not played this episode's seed.");
  if (!logOf(row)) throw new Error("No log of the other submission's episode can be seen.");
  return logOf(row);
}

function form(own, log, found) {
  const choice = h("select", {id: "other"}, found.map((one) => h("option", {value: one.submission},
    `${Number.isFinite(one.rank) ? `${one.rank}. ` : ""}${visible(nameOf(one))}`)));
  const problem = h("p", {class: "problem", role: "alert"});
  return h("form", {onsubmit: async (event) => {
    event.preventDefault();
    problem.textContent = "";
    try {
      const other = await sameEpisode(own, log, Number(choice.value));
      location.assign(`/replay?${new URLSearchParams([["log", log], ["of", own.submission],
        ["log", other], ["of", choice.value]])}`);
    } catch (error) {
      problem.textContent = visible(error.message);
    }
  }}, h("div", {class: "row"}, h("label", {for: "other", class: "inline"}, "Beside it ", choice),
    h("button", {type: "submit"}, "Show both")), problem);
}

// Offers the same episode of other submissions beside the one of `log`; `own` is the status of its
// submission.
export function compare(own, log) {
  const box = h("div", null, h("p", {class: "quiet"}, "Looking for others…"));
  others(own).then((found) => {
    box.replaceChildren(found.length ? form(own, log, found) : h("p", {class: "quiet"},
      "You may see no other submission on this track."));
  }).catch((error) => box.replaceChildren(h("p", {class: "problem"}, visible(error.message))));
  return h("details", {class: "card compare"}, h("summary", null,
    "Compare with the same episode of another submission"), box);
}
