// The first page: each challenge with what its host says, its phases over time, and the leaders of its boards.
import {get, isOrganiser, token, whoami} from "./api.js";
import {h, href, replace} from "./dom.js";
import {boardTitle, briefly, dateTime, name, time, visible, whole} from "./format.js";
import {homeReplay} from "./home_replay.js";
import {hostText} from "./host_text.js";
import {boardAddress, deciding, phaseWhen, rankedRows, successes} from "./places.js";
import {publicReplays} from "./replays.js";

const SHOWN = 3;

function leader(row, columns) {
  const decides = deciding(row, columns);
  return h("li", null,
    h("span", {class: "rank"}, row.rank === null ? "–" : row.rank),
    h("span", {class: "who-leads"}, h("a", {href: href("/team", {name: row.team})}, name(row.team)),
      row.baseline && h("span", {class: "tag"}, "baseline")),
    h("span", {class: "figure"}, successes(row), decides && [", ",
      h("span", {title: `${decides.title} decides here`}, decides.text)]));
}

// Fills a box with the leaders of a board; the teams that are on it.
async function fillLeaders(box, query) {
  try {
    const board = await get(boardAddress({query}));
    if (!board.rows.length) {
      replace(box, h("p", {class: "quiet"}, "Nobody is ranked yet."));
      return [];
    }
    const ranked = rankedRows(board);
    const columns = briefly(board);
    const decides = deciding(ranked[0] ?? {}, columns);
    replace(box,
      h("p", {class: "quiet"}, `${board.rows.length} ${board.rows.length === 1 ? "entry" : "entries"}, with `
        + `success${decides ? ` and ${decides.title.toLowerCase()}, which decides` : ""}`),
      h("ol", {class: "leaders"}, board.rows.slice(0, SHOWN).map((row) =>
        leader(row, columns))));
    return ranked.map((row) => row.team);
  } catch (error) {
    replace(box, h("p", {class: "problem"}, visible(error.message)));
    return [];
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

// The phases that have dates, as bars over one line of time with the present marked. What it says is in the cards
// as well.
function timeline(phases, now) {
  const dated = phases.filter((phase) => phase.opens_at || phase.closes_at);
  if (!dated.length) return null;
  const ends = dated.flatMap((phase) => [phase.opens_at, phase.closes_at]).filter((at) => at)
    .map((at) => Date.parse(at)).concat(Date.parse(now));
  const [first, last] = [Math.min(...ends), Math.max(...ends)];
  const margin = 0.02 * (last - first || 1);
  const at = (moment) => 100 * (moment - first + margin) / (last - first + 2 * margin);
  const bars = dated.map((phase) => {
    const from = phase.opens_at ? at(Date.parse(phase.opens_at)) : 0;
    const to = phase.closes_at ? at(Date.parse(phase.closes_at)) : 100;
    const bar = h("span", {class: `span ${phase.state}`});
    bar.style.left = `${from}%`;
    bar.style.width = `${Math.max(to - from, 0.6)}%`;
    return h("li", null, h("a", {href: href("/board", {phase: phase.phase})}, visible(phase.title)),
      h("span", {class: "track-of-time"}, bar));
  });
  const present = h("span", {class: "present", title: "now", "aria-hidden": "true"});
  present.style.left = `${at(Date.parse(now))}%`;
  return h("div", {class: "timeline"}, h("div", {class: "lines"}, h("ol", {class: "plain"}, bars), present),
    h("p", {class: "quiet ends"}, h("span", null, dateTime(new Date(first).toISOString())),
      h("span", null, dateTime(new Date(last).toISOString()))));
}

// What comes next: the first close of a phase that is open, else the first opening.
function next(phases) {
  const soonest = (key, state) => phases.filter((phase) => phase.state === state && phase[key])
    .sort((a, b) => Date.parse(a[key]) - Date.parse(b[key]))[0];
  const closing = soonest("closes_at", "open");
  if (closing) return ["“", visible(closing.title), "” closes ", time(closing.closes_at), "."];
  const opening = soonest("opens_at", "upcoming");
  if (opening) return ["“", visible(opening.title), "” opens ", time(opening.opens_at), "."];
  return null;
}

function boardsOf(tracks, track) {
  return tracks.find((one) => one.track === track)?.boards ?? ["main"];
}

// The way to a submission: its form, or for strangers the first step.
function actions() {
  return h("p", {class: "row"}, h("a", {class: "button main", href: token() ? "/submit"
    : href("/sign-in", {to: "/submit"})}, "Submit a policy"),
  h("a", {class: "button", href: "/docs"}, "How to take part"));
}

function challengePart(challenge, now, tracks, titled, replay) {
  const {phases} = challenge;
  const waiting = [];
  const counts = h("p", {class: "quiet counts"});
  const submissions = phases.reduce((sum, phase) => sum + phase.submissions, 0);
  const cards = h("div", {class: "cards"}, phases.map((phase) => card(visible(phase.title), phaseWhen(phase),
    {phase: phase.phase}, boardsOf(tracks, phase.track), waiting)));
  const filled = Promise.all(waiting).then((teams) => {
    const count = new Set(teams.flat()).size;
    counts.textContent = `${whole(count)} ${count === 1 ? "team" : "teams"} ranked, ${whole(submissions)} `
      + `${submissions === 1 ? "submission" : "submissions"}`;
  });
  const coming = next(phases);
  return {filled, element: h("section", {class: "challenge"},
    !titled && h("h2", null, visible(challenge.title)),
    h("div", {class: `hero${replay ? " with-replay" : ""}`},
      h("div", null, challenge.logo && h("img", {class: "logo", alt: `Logo of ${visible(challenge.title)}`,
        src: `/v1/challenges/${encodeURIComponent(challenge.challenge)}/logo.png`}), challenge.text.length > 0 && hostText(challenge.text), actions()),
      h("div", null, replay, coming && h("p", {class: "coming"}, coming), timeline(phases, now), counts)),
    h("h2", {class: titled ? null : "hidden"}, "Boards"), cards)};
}

// On a server without anything, what its organiser does first.
function firstSteps() {
  return h("section", {class: "card"}, h("h2", null, "First steps"), h("ol", null,
    h("li", null, "Submit the baselines, or a policy of your own: ", h("a", {href: "/submit"}, "Submit"), "."),
    h("li", null, "Describe a challenge with its phases in a file: ", h("a", {href: "/docs"}, "Documents"),
      ", “Holding a challenge”."),
    h("li", null, "Create teams and give each a token: ", h("code", null, "myograde token create"), ".")));
}

export async function show(main) {
  const [{tracks}, all, who, replays] = await Promise.all([get("/v1/tracks"), get("/v1/challenges"), whoami(),
    publicReplays()]);
  const only = all.challenges.length === 1 ? all.challenges[0] : null;
  const title = only ? visible(only.title) : "Boards";
  document.title = only ? `${title} – MyoGrade` : "Boards – MyoGrade";
  const waiting = [];
  // One is enough for a page: that of the first phase which has one, if possible of an open one.
  const played = all.challenges.flatMap(({phases}) => phases)
    .filter(({phase}) => replays.some((one) => one.phase === phase));
  const shown = played.find(({state}) => state === "open") ?? played[0];
  const replay = replays.find(({phase}) => phase === (shown?.phase ?? null));
  const phaseOf = ({phases}) => phases.find((phase) => phase === shown);
  const parts = all.challenges.map((challenge) => challengePart(challenge, all.now, tracks, challenge === only,
    phaseOf(challenge) && homeReplay(replay, phaseOf(challenge).title)));
  const ofPhases = new Set(all.challenges.flatMap((challenge) => challenge.phases).map((phase) => phase.track));
  const open = tracks.filter((track) => !ofPhases.has(track.track));
  const ofTracks = open.map((track) => card(track.track, [], {track: track.track}, track.boards, waiting));
  const former = all.former_phases.map((phase) => card(phase.phase,
    [h("p", null, h("span", {class: "state closed"}, "former"))], {phase: phase.phase},
    boardsOf(tracks, phase.track), waiting));
  const steps = h("div");
  replace(main, h("h1", null, title),
    all.paused && h("p", {class: "notice"}, "Submissions are paused: ", visible(all.paused.reason)),
    !all.challenges.length && [h("p", {class: "lead"}, "MyoGrade plays policies on simulated bodies and ranks "
      + "them. Each track has a board."), actions()],
    steps, replay && !replay.phase && homeReplay(replay, replay.track), parts.map((part) => part.element),
    open.length > 0 && h("section", null, h("h2", null, "Tracks"), h("div", {class: "cards"}, ofTracks)),
    former.length > 0 && h("section", null, h("h2", null, "Former phases"), h("div", {class: "cards"}, former)));
  const teams = await Promise.all(waiting);
  await Promise.all(parts.map((part) => part.filled));
  if (!all.challenges.length && isOrganiser(who) && !teams.flat().length) replace(steps, firstSteps());
}
