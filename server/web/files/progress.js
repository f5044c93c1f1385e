// How a team's place on a board came to be: the boards of the moments at which something of it changed.
import {get} from "./api.js";
import {h, s} from "./dom.js";
import {dateTime, time, whole} from "./format.js";
import {boardAddress, rankedRows} from "./places.js";

const MOST_MOMENTS = 12;
const MOST_ENTRIES = 20000;  // of the record
const WIDTH = 360;
const HEIGHT = 96;
const LEFT = 30;
const RIGHT = 10;
const EDGE = 16;

let record = null;

// The public record, oldest first, read once.
async function entries() {
  const all = [];
  for (let from = 0; from !== null && all.length < MOST_ENTRIES;) {
    const page = await get(`/v1/record?limit=1000&from=${from}`);
    all.push(...page.entries.map((one) => one.entry));
    from = page.next_from > from ? page.next_from : null;
  }
  return all;
}

// When something changed for the team on the board, the first and the last among them; evenly fewer of many.
function momentsOf(all, team, {track, profile, phase}) {
  const own = new Set();
  const found = new Set();
  for (const entry of all) {
    if (entry.kind === "accepted" && entry.team === team && entry.track === track && entry.profile === profile
      && entry.phase === phase) own.add(entry.submission);
    if (["graded", "marked", "chosen"].includes(entry.kind) && own.has(entry.submission)) found.add(entry.at);
  }
  const at = [...found];
  if (at.length <= MOST_MOMENTS) return at;
  return Array.from({length: MOST_MOMENTS}, (_, place) =>
    at[Math.floor(place * (at.length - 1) / (MOST_MOMENTS - 1))]);
}

// {at, rank, of} at each moment at which the team had a rank, the last being now.
async function ranksOf(team, {query, board, answer}) {
  record ??= entries();
  const moments = momentsOf(await record, team, answer);
  const boards = await Promise.all(moments.map((at) => get(boardAddress({query, board}, {at})).catch(() => null)));
  const now = new Date().toISOString();
  return [...moments.map((at, place) => [at, boards[place]]), [now, answer]].flatMap(([at, then]) => {
    const ranked = then ? rankedRows(then) : [];
    const row = ranked.find((one) => one.team === team);
    return row ? [{at, rank: row.rank, of: ranked.length}] : [];
  });
}

function drawing(points, words) {
  const [begin, end] = [points[0], points.at(-1)].map((point) => Date.parse(point.at));
  const worst = Math.max(...points.map((point) => point.rank), 2);
  const x = (at) => LEFT + (WIDTH - LEFT - RIGHT) * (Date.parse(at) - begin) / Math.max(end - begin, 1);
  const y = (rank) => EDGE + (HEIGHT - 2 * EDGE) * (rank - 1) / (worst - 1);
  const line = points.flatMap((point, place) => [
    ...(place ? [`${x(point.at)},${y(points[place - 1].rank)}`] : []), `${x(point.at)},${y(point.rank)}`]);
  return s("svg", {viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": words},
    [1, worst].map((rank) => [s("line", {class: "grid", x1: LEFT, x2: WIDTH - RIGHT, y1: y(rank), y2: y(rank)}),
      s("text", {x: LEFT - 6, y: y(rank) + 4, "text-anchor": "end"}, rank)]),
    s("polyline", {class: "rank-line", points: line.join(" ")}),
    points.map((point) => s("circle", {class: "rank-dot", cx: x(point.at), cy: y(point.rank), r: 3})));
}

// A figure of a team's rank on one of its places (places.js) over time; null without a rank.
export async function progress(team, place, title) {
  const points = await ranksOf(team, place);
  if (!points.length) return null;
  const best = Math.min(...points.map((point) => point.rank));
  const words = `from rank ${points[0].rank} to rank ${points.at(-1).rank}, best ${best}`;
  return h("figure", {class: "chart"}, h("figcaption", null, title),
    points.length > 1 && drawing(points, `Rank over time: ${words}`),
    h("p", {class: "quiet"}, `Rank ${whole(points.at(-1).rank)} of ${whole(points.at(-1).of)}; best ${best}. First on `
      + "this board ", time(points[0].at), ", ", dateTime(points[0].at), "."));
}
