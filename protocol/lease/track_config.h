// A track config: everything that a result of a track is a function of, apart
// from the submission and the grader build. Loaded from configs/tracks/*.json,
// where "extends" names a config to start from and "profiles" holds the rules
// profiles; what is kept here is the effective config of one profile.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/tracks/track_kind.h"

namespace myograde {

// What a participant's processes may use. Every number is a limit that is
// enforced; none can be zero, absent or "unlimited". RULES: 'Budgets'.
struct Budgets {
  double startup_s;          // s until the policy has said hello and is ready in which it ran or
                             // wanted no processor; waiting for processors and disks is not counted
  double startup_wall_s;     // s of wall time of the same
  double step_s;             // s of the policy's CPU time for a step without overtime
  double overtime_s;         // s of CPU time: the bank of overtime of an episode
  double wall_factor;        // wall caps of step and bank: this many times their CPU budgets
  double lease_cpu_s;        // s of CPU time of the whole lease
  double lease_wall_s;       // s of wall time of the whole lease
  double lease_idle_s;       // s of that in which it was asked and wanted no processor
  int64_t memory_bytes;
  double cpus;               // processors
  int64_t tasks;             // processes and threads
  int64_t scratch_bytes;     // private /tmp and /dev/shm together
  int64_t scratch_files;     // inodes there
  int64_t output_bytes;      // kept of each of stdout and stderr
  int64_t open_files;
  int64_t stray_messages;    // messages on the bus that answer nothing, per episode
  int64_t wrong_answers;     // answers to a step that was not asked, per episode
  int64_t restarts;          // fresh sandboxes after a participant's fault, per lease
  int64_t submission_bytes;  // unpacked size of a submission
  int64_t submission_files;
};

// How an evaluation of the track is ranked; parsed by the server into
// scoring's own values. See scoring/ for the meaning.
struct TrackConfig {
  std::string id;            // the name of the config file, without ".json"
  const TrackKind* kind = nullptr;  // never null in a config that was parsed
  std::string profile;       // "paper", "myosuite", "as-graded"
  int64_t episodes_per_lease;
  std::vector<uint64_t> seeds;  // one per episode; its length is the full evaluation
  // What policy seeds follow from (policy_seed.h); nullopt in configs of form 1 alone.
  std::optional<std::string> policy_seed_secret;
  Budgets budgets;
  nlohmann::json rules;      // the environment's numbers and switches, which sim/<track>/ parses
  nlohmann::json scoring;    // judging and boards, which scoring/<track>/ parses
  nlohmann::json effective;  // the whole effective config as canonical JSON value
  std::string hash;          // SHA-256 (hex) of CanonicalJson(effective)
};

// Parses an effective config (as kept in TrackConfig::effective and handed on
// in lease orders) of any form (track_config_forms.h): `effective` and `hash` are of what was
// given, the rest says it in today's keys. Unknown keys and values out of range are errors.
absl::StatusOr<TrackConfig> ParseTrackConfig(const nlohmann::json& effective,
                                             const std::string& where);

// Loads `track` (a name, looked up as DIR/NAME.json) in `profile` ("" = the
// config's default_profile), resolves "extends" and the profile, and parses.
absl::StatusOr<TrackConfig> LoadTrackConfig(const std::string& tracks_dir,
                                            const std::string& track,
                                            const std::string& profile);

// The seeds of a config or of a participant's seed file: {"first": N, "count": K} or a list of
// whole numbers from 0 to 2^63 - 1 without repetition; 1 to kMaxEpisodes of them.
inline constexpr int64_t kMaxEpisodes = 10000;
absl::StatusOr<std::vector<uint64_t>> ParseSeeds(const nlohmann::json& json,
                                                 const std::string& where);

// The same config over other seeds (a practice run): effective config and hash follow, the
// policy seeds of an index stay.
// Errors as ParseSeeds.
absl::StatusOr<TrackConfig> WithSeeds(const TrackConfig& config,
                                      const std::vector<uint64_t>& seeds);

// The rules profiles that `track` has, sorted; errors as LoadTrackConfig.
absl::StatusOr<std::vector<std::string>> ListProfiles(const std::string& tracks_dir,
                                                      const std::string& track);

// Names of configs and profiles: 1 to 64 of a-z, 0-9 and "-", so that they are safe in paths.
bool IsTrackName(std::string_view name);

// The names of the configs in a folder, sorted.
absl::StatusOr<std::vector<std::string>> ListTracks(const std::string& tracks_dir);

}  // namespace myograde
