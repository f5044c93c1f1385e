// Whose same episode can be shown beside one, as far as the reader may see it: the API decides that.
import {get} from "./api.js";
import {h, href} from "./dom.js";
import {visible} from "./format.js";
import {replayAddress} from "./replays.js";

const MOST = 100;

async function rowOf(submission, index) {
  const answer = await get(`/v1/submissions/${submission}/result?episodes=1&first=${index}`
    + `&last=${index}&details=0`);
  return {row: answer.episode_rows?.[0] ?? null, seeds: answer.hashes.seeds};
}

// A submission in a list, as people know it.
export function nameOf(status) {
  return `${status.team}: ${status.name || `submission ${status.submission}`}`;
}

// Other submissions that were played by the same rules, those of its board's leaders first.
export async function others(own) {
  const list = await get(href("/v1/submissions", {track: own.track, profile: own.profile,
    phase: own.phase, limit: MOST}));
  const board = await get(href("/v1/leaderboard", own.phase ? {phase: own.phase}
    : {track: own.track, profile: own.profile})).catch(() => ({rows: []}));
  const ranks = new Map(board.rows.map((row) => [row.submission, row.rank ?? Infinity]));
  return list.submissions.filter((one) => one.submission !== own.submission && one.episodes.done > 0)
    .map((one) => ({...one, rank: ranks.get(one.submission) ?? Infinity}))
    .sort((a, b) => (a.rank === b.rank ? b.submission - a.submission : a.rank - b.rank));
}

// The log of another submission's episode on the same seed.
async function sameEpisode(own, index, other) {
  const [mine, theirs] = await Promise.all([rowOf(own.submission, index), rowOf(other, index)]);
  const same = mine.seeds === theirs.seeds || ((mine.row?.seed ?? null) !== null
    && mine.row.seed === theirs.row?.seed);
  if (!theirs.row || !same) throw new Error("It has not played this episode's seed.");
  if (!theirs.row.log) throw new Error("No log of its episode can be seen.");
  return theirs.row.log.sha256;
}

function form(own, episode, found) {
  const choice = h("select", {id: "other"}, found.map((one) => h("option", {value: one.submission},
    `${Number.isFinite(one.rank) ? `${one.rank}. ` : ""}${visible(nameOf(one))}`)));
  const problem = h("p", {class: "problem", role: "alert"});
  return h("form", {onsubmit: async (event) => {
    event.preventDefault();
    problem.textContent = "";
    try {
      const log = await sameEpisode(own, episode.index, Number(choice.value));
      location.assign(replayAddress({log: episode.log, of: own.submission},
        {log, of: choice.value}));
    } catch (error) {
      problem.textContent = visible(error.message);
    }
  }}, h("div", {class: "row"}, h("label", {for: "other", class: "inline"}, "Submission ", choice),
    h("button", {type: "submit"}, "Show both")), problem);
}

// Offers the same episode of other submissions beside `episode` ({log, index}); `own` is the status of
// its submission. They are looked for once the reader asks.
export function compare(own, episode) {
  const box = h("div", null, h("p", {class: "quiet"}, "Looking for others…"));
  const look = async () => {
    try {
      const found = await others(own);
      box.replaceChildren(found.length ? form(own, episode, found) : h("p", {class: "quiet"},
        "You may see no other submission on this track."));
    } catch (error) {
      box.replaceChildren(h("p", {class: "problem"}, visible(error.message)));
    }
  };
  return h("details", {class: "card compare", ontoggle: (event) => {
    if (event.target.open && !box.dataset.asked) {
      box.dataset.asked = "yes";
      look();
    }
  }}, h("summary", null, "Compare with the same episode of another submission"), box);
}
