// Where episodes are shown in motion.
import {get} from "./api.js";

let open = null;

// The episodes that everybody may watch, as GET /v1/replays has them; none if that can't be asked.
export function publicReplays() {
  open ??= get("/v1/replays").then(({replays}) => replays, () => []);
  return open;
}

// The address that an episode's files are below: for everybody if it is among publicReplays.
export function filesOf(log, isPublic) {
  return `/v1/${isPublic ? "replays" : "logs"}/${log}`;
}

// The page with one episode or with two beside each other: {log, of}, where `of` is the submission.
export function replayAddress(...episodes) {
  return `/replay?${new URLSearchParams(episodes.flatMap(({log, of}) => [["log", log], ["of", of]]))}`;
}

async function leaderOf(status, result) {
  const board = status.phase ? {phase: status.phase}
    : {track: status.track, profile: status.profile, config: result.hashes.config};
  const {rows} = await get(`/v1/leaderboard?${new URLSearchParams(board)}`);
  return rows.find((row) => !row.baseline)?.submission ?? null;
}

let leader = null;  // of this page's submission, once it is asked for

// The leader's same episode, {log, of}; null if this is the leader, or the reader may not see it: the API
// decides that.
export async function leadersEpisode(status, result, index) {
  leader ??= leaderOf(status, result).catch(() => null);
  const of = await leader;
  if (of === null || of === status.submission) return null;
  const answer = await get(`/v1/submissions/${of}/result?episodes=1&first=${index}&last=${index}`
    + "&details=0").catch(() => null);
  const log = answer?.episode_rows?.[0]?.log?.sha256;
  const same = answer?.hashes.seeds === result.hashes.seeds
    && answer?.hashes.config === result.hashes.config;
  return log && same ? {log, of} : null;
}
