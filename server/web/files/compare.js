// Who else has played an episode whose log the reader may see: the API decides that.
import {get} from "./api.js";
import {visible} from "./format.js";
import {verdict} from "./grid.js";

const MOST = 12;

let found = null;  // of this page's submission: {submission, words, leader}, the leader first

async function leaderOf(status, result) {
  const board = status.phase ? {phase: status.phase}
    : {track: status.track, profile: status.profile, config: result.hashes.config};
  const {rows} = await get(`/v1/leaderboard?${new URLSearchParams(board)}`);
  return rows.find((row) => !row.baseline && row.submission !== status.submission) ?? null;
}

async function candidates(status, result) {
  const own = await get(`/v1/submissions?${new URLSearchParams({team: status.team,
    track: status.track, limit: 50})}`).catch(() => ({submissions: []}));
  const leader = await leaderOf(status, result).catch(() => null);
  return [
    ...(leader ? [{submission: leader.submission, leader: true,
      words: `The leader, ${visible(leader.team)}`}] : []),
    ...own.submissions.filter((one) => one.submission !== status.submission
      && one.submission !== leader?.submission && one.episodes.done > 0
      && one.profile === status.profile).map((one) => ({submission: one.submission, leader: false,
      words: `Submission ${one.submission}${one.name ? `, ${visible(one.name)}` : ""}`})),
  ];
}

// The log of a candidate's same episode, played on the same seed; null if the reader may not see it.
async function logOf(candidate, result, row) {
  const answer = await get(`/v1/submissions/${candidate.submission}/result?episodes=1`
    + `&first=${row.index}&last=${row.index}&details=0`).catch(() => null);
  const [other] = answer?.episode_rows ?? [];
  if (!other?.log || answer.hashes.seeds !== result.hashes.seeds
      || answer.hashes.config !== result.hashes.config) return null;
  return {...candidate, log: other.log.sha256, verdict: verdict(other)};
}

// {submission, words, leader, log, verdict} of those who have played the episode `row`, of the first `most`
// that come into question.
export async function rivals(status, result, row, most = MOST) {
  found ??= candidates(status, result).catch(() => []);
  const logs = await Promise.all((await found).slice(0, most).map((one) => logOf(one, result, row)));
  return logs.filter((one) => one);
}
