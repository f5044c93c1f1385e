// Where episodes are shown in motion.

// The page with one episode, or with several beside each other, by the hashes of their logs.
export function replayAddress(...logs) {
  return `/replay?${new URLSearchParams(logs.map((log) => ["log", log]))}`;
}
