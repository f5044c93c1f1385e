// The order for one lease and its results. The daemon (or `myograde local`, or a node of a cluster)
// writes a LeaseOrder as a JSON file and starts `myograde-runner FILE`; the runner prints one
// LeaseRecord per line on stdout.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/tracks/episode_facts.h"
#include "protocol/lease/policy_image.h"
#include "protocol/lease/track_config.h"

namespace myograde {

struct EpisodeOrder {
  int64_t index = 0;         // in the evaluation, from 0
  uint64_t seed = 0;         // of the environment; never shown to the policy
  uint64_t policy_seed = 0;  // for the policy's own randomness
};

// What to run: a submission's program.
struct LeaseProgram {
  std::string artefact_dir;        // unpacked submission, mounted read-only at /policy
  // Run in /policy; command[0] is relative to it, absolute, or a word to look up in PATH.
  std::vector<std::string> command;
  std::map<std::string, std::string> environment;  // environment variables for the policy
  std::vector<std::string> runtimes;  // host folders mounted read-only at their own path
  // Program of the grader that plays the command; "": it speaks LCM itself.
  std::string adapter = {};
  // The policy is shown TrackLayout::extra after the graded observation.
  bool extra_observations = false;
  // The submission is a container image: artefact_dir's folder kImageFolder is the policy's root, and
  // the command starts in it.
  std::optional<PolicyImage> image = {};
};

// Where to run it.
struct LeasePlace {
  int64_t slot = 0;
  // Unprivileged uid and gid of the slot; -1: the caller's own, or set by whoever starts the
  // runner.
  int64_t uid = -1;
  bool pinned = false;             // the slot is pinned to one processor, the slot-th of the
                                   // runner's
  std::string work_dir;            // empty folder of the lease, owned by the caller
  std::string cache_dir;           // models (MYOGRADE_CACHE)
  std::string log_dir;             // where episode logs are kept; "": nowhere
};

struct LeaseOrder : LeaseProgram, LeasePlace {
  std::string lease;               // id, for messages and names of temporary files
  TrackConfig track;
  std::vector<EpisodeOrder> episodes;  // consecutive indices
  // Empty folder of the slot that its sandboxes mount, which identifies their processes from
  // outside; "": none.
  std::string slot_mark;
  int64_t log_bytes = 0;           // largest packed log; filled in by the runner from its config
  // Log files, packed or not, one per episode: replay them without a policy, and compare. Needs
  // neither an artefact nor a command.
  std::vector<std::string> replay;
  // With `replay`: the file that gets the trajectory of the last episode (sim/trajectory/README.md),
  // unless it differs from its log; "": none is made.
  std::string trajectory = {};
  bool background = false;  // gets little of processors that others want too
};

nlohmann::json LeaseOrderToJson(const LeaseOrder& order);
absl::StatusOr<LeaseOrder> LeaseOrderFromJson(const nlohmann::json& json,
                                              const std::string& where);

// The runner is alive; at least one every second. Serves as the heartbeat.
struct ProgressRecord {
  int64_t episode = 0;  // index in the evaluation
  int64_t step = 0;
};

// The result of replaying an episode from its log.
struct ReplayRecord {
  int64_t episode = 0;
  bool equal = false;
  int64_t steps = 0;      // number of steps compared
  int64_t step = -1;      // if not equal: the first that differs, -1 if none of them does
  // What differs there: "observation", "state", "digest", "end", "steps"; or "log": it can't be
  // replayed at all.
  std::vector<std::string> differs;
  std::string detail;     // if not equal: one sentence
};

// Always the last record of a lease.
struct LeaseEndRecord {
  bool ok = false;          // all episodes were recorded
  std::string detail;       // if not ok: the grader's fault in one sentence
  std::string stdout_tail;  // last 4 KiB of the policy's output, made valid UTF-8
  std::string stderr_tail;
  bool stdout_truncated = false;  // the output exceeded Budgets::output_bytes
  bool stderr_truncated = false;
  double policy_cpu_s = 0;
  double simulator_cpu_s = 0;     // 0: not measured on this host
  double wall_s = 0;
  int64_t peak_memory_bytes = 0;  // 0: not measured on this host
};

// Where a runner is, and what it used: for people and their accounts, not for any decision.
struct RunnerSite {
  std::string node = {};                // "": this host; of a lease on a cluster: none has begun it
  std::string job = {};                 // the cluster's number for it, such as 1234; "": no job
  double cpu_s = 0;                     // of all processes of the lease; 0: not known (yet)
  std::optional<double> energy_j = {};  // of the job, where the cluster measures it
};

// Of a lease on a cluster: where it is and what became of it, beside its runner's records. Each one
// replaces the one before.
struct NodeRecord : RunnerSite {
  std::string processor = {};  // as the kernel names it; "": the node has not proved itself (yet)
  std::string trouble = {};    // why the cluster takes no job for it; it is asked again
  std::string unfit = {};      // why the node's results would not be the daemon's, or can't be
  std::string lost = {};       // why it was not played to its end, though that is not a fault of the grader's
  bool blamed = false;         // the node is to blame for that
};

using LeaseRecord =
    std::variant<ProgressRecord, EpisodeFacts, LeaseEndRecord, ReplayRecord, NodeRecord>;

// 1 to 255 letters, digits, dots, hyphens and underscores; neither "." nor "..".
bool IsNodeName(std::string_view name);

// One line of JSON without the newline, and the reverse. Non-finite numbers never occur. `type` is
// "progress", "episode", "replay", "lease_end" or "node".
std::string LeaseRecordToLine(const LeaseRecord& record);
absl::StatusOr<LeaseRecord> LeaseRecordFromLine(std::string_view line);
absl::StatusOr<LeaseRecord> LeaseRecordFromJson(const nlohmann::json& json);

// Without the details: it is what a result's row keeps as its facts.
nlohmann::json EpisodeFactsToJson(const EpisodeFacts& facts);
// Reads the details too, where the key "details" is there.
absl::StatusOr<EpisodeFacts> EpisodeFactsFromJson(const nlohmann::json& json);

// An episode's record: its facts and, where it has some, its details.
nlohmann::json EpisodeRecordToJson(const EpisodeFacts& facts);

// One object with a key for each detail; numbers are rounded to six decimals,
// angles to four.
nlohmann::json DetailsToJson(const TrackDetails& details);
// The details of an episode with facts of this track. InvalidArgumentError: a key is missing, unknown
// or no number.
absl::StatusOr<TrackDetails> DetailsFromJson(const TrackFacts& track, const nlohmann::json& json);

}  // namespace myograde
