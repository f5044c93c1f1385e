// Where a team stands on all boards, as everybody may see it.
import {get} from "./api.js";
import {h, href, table} from "./dom.js";
import {boardTitle, briefly, dateTime, heading, measure, name, percent, time, visible, whole} from "./format.js";

// Every board that there is: {title, query, board, phase}, where `phase` is as the API tells of it, null for a
// track's own. Those of phases come first, in the order of their challenges' files.
export async function allBoards() {
  const [{tracks}, all] = await Promise.all([get("/v1/tracks"), get("/v1/challenges")]);
  const boardsOf = (track) => tracks.find((one) => one.track === track)?.boards ?? ["main"];
  const phases = all.challenges.flatMap((challenge) => challenge.phases);
  const withPhases = new Set(phases.map((phase) => phase.track));
  const each = (title, query, track, phase) => boardsOf(track).map((board) => ({title, query, board, phase}));
  return [
    ...phases.flatMap((phase) => each(phase.title, {phase: phase.phase}, phase.track, phase)),
    ...all.former_phases.flatMap((phase) => each(phase.phase, {phase: phase.phase}, phase.track, null)),
    ...tracks.filter((one) => !withPhases.has(one.track))
      .flatMap((one) => each(one.track, {track: one.track}, one.track, null))];
}

let known = null;

// Phases by their ids, in the order of their challenges' files.
export function phasesKnown() {
  known ??= get("/v1/challenges").then(({challenges}) => new Map(challenges.flatMap((challenge) =>
    challenge.phases.map((phase) => [phase.phase, phase]))), (error) => {
    known = null;
    throw error;
  });
  return known;
}

// What phases are called: a function from a row of the API, with its phase and track, to a text.
export async function phaseTitles() {
  const phases = await phasesKnown();
  return ({phase, track}) => visible(phase ? phases.get(phase)?.title ?? phase : track);
}

// Whether a phase takes submissions and whether its board moves, with the dates that matter.
export function phaseWhen(phase) {
  const frozen = phase.frozen && !phase.published;
  const state = h("span", {class: `state ${phase.state}`}, phase.state);
  const dates = [
    phase.state === "upcoming" && ["opens ", phase.opens_at],
    phase.closes_at && [phase.state === "closed" ? "closed " : "closes ", phase.closes_at],
    phase.freeze_at && !phase.published && [frozen ? "board frozen since " : "board freezes ", phase.freeze_at],
  ].filter((one) => one);
  return h("p", {class: "when"}, state, frozen && h("span", {class: "state frozen"}, "frozen"),
    dates.map(([words, at]) => [" ", h("span", null, words, dateTime(at), " (", time(at), ")")]),
    phase.paused && h("span", {class: "problem"}, "Paused: ", visible(phase.paused.reason)));
}

export const boardAddress = ({query, board = "main"}, more = {}) =>
  `/v1/leaderboard?${new URLSearchParams({...query, board, ...more})}`;

// The rows of a board that have a rank.
export const rankedRows = (board) => board.rows.filter((row) => !row.baseline);

// What decides among the rows around a row: its value as a text, with the unit; null where that is successes.
export function deciding(row, columns) {
  const metric = columns.find((column) => column.name === row.decided_by);
  return metric ? {title: heading({...metric, unit: ""}), text: measure(row.aggregate?.[metric.name], metric)}
    : null;
}

export const successes = ({aggregate}) => percent(aggregate?.successes, aggregate?.episodes);

// The boards on which a team stands: {...board, answer, rows}. A board that can't be read is left out.
export async function placesOf(team) {
  const boards = await allBoards();
  const answers = await Promise.all(boards.map((one) => get(boardAddress(one)).catch(() => null)));
  return boards.map((one, place) => ({...one, answer: answers[place],
    rows: answers[place]?.rows.filter((row) => row.team === team) ?? []})).filter((one) => one.rows.length);
}

// The places as a table.
export function placesTable(places) {
  return table("Places", ["Board", "Rank#", "Policy", "Success#", "What decides"],
    places.flatMap(({title, query, board, answer, rows}) => rows.map((row) => {
      const decides = deciding(row, briefly(answer));
      return h("tr", null,
        h("th", {scope: "row"}, h("a", {href: href("/board", {...query, board})}, title),
          board !== "main" && [", ", boardTitle(board)]),
        h("td", {class: "num"}, row.baseline ? "baseline"
          : [h("b", null, row.rank), ` of ${whole(rankedRows(answer).length)}`]),
        h("td", null, name(row.name || `submission ${row.submission}`)),
        h("td", {class: "num"}, successes(row)),
        h("td", null, decides ? `${decides.title} ${decides.text}` : "successes"));
    })));
}
