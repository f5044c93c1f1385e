// A track config: everything that a result of a track depends on, apart from the submission and the
// grader build. Loaded from configs/tracks/*.json, where "extends" names a config to start from and
// "profiles" holds the rules profiles; this is the effective config of one profile.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/tracks/track_kind.h"

namespace myograde {

// What a participant's processes may use. Every number is an enforced limit; none can be zero,
// absent or "unlimited". RULES: 'Budgets'.
struct Budgets {
  double startup_s;          // s until the policy has said hello and is ready, counting time in
                             // which it ran or wanted no processor, but not waits for processors
                             // and disks
  double startup_wall_s;     // s of wall time until ready
  double step_s;             // s of the policy's CPU time for a step without overtime
  double overtime_s;         // s of CPU time: an episode's bank of overtime
  double wall_factor;        // wall-clock limits of step and bank, as a multiple of their CPU
                             // budgets
  double lease_cpu_s;        // s of CPU time of the whole lease
  double lease_wall_s;       // s of wall time of the whole lease
  double lease_idle_s;       // s of that in which the policy owed an answer and wanted no processor
  int64_t memory_bytes;
  double cpus;               // processors
  int64_t tasks;             // processes and threads
  int64_t scratch_bytes;     // private /tmp and /dev/shm together
  int64_t scratch_files;     // inodes there
  int64_t output_bytes;      // bytes kept of stdout and of stderr
  int64_t open_files;
  int64_t stray_messages;    // messages on the bus that answer nothing, per episode
  int64_t wrong_answers;     // answers to a step that is not the one asked, per episode
  int64_t restarts;          // fresh sandboxes after a participant's fault, per lease
  int64_t submission_bytes;  // unpacked size of a submission
  int64_t submission_files;
};

// How an evaluation of the track is ranked; parsed by the server into scoring's own values. See
// scoring/ for the meaning.
struct TrackConfig {
  std::string id;            // the name of the config file, without ".json"
  const TrackKind* kind = nullptr;  // never null in a parsed config
  std::string profile;       // "paper", "myosuite", "as-graded"
  int64_t episodes_per_lease;
  std::vector<uint64_t> seeds;  // one per episode of the full evaluation
  // What practice plays, in order; none of them is in `seeds`. Empty unless the config's file names
  // some. Not part of the effective config and its hash.
  std::vector<uint64_t> practice_seeds = {};
  // A submission may ask for TrackLayout::extra. Not part of the effective config and its hash.
  bool extra_observations = false;
  // The phase of a challenge that plays it; "": a track's own board.
  std::string phase;
  // What commitments to the seeds are made with (seed_commitment.h), 64 hexadecimal digits; "": the
  // seeds are public. As secret as the seeds, until the phase reveals them.
  std::string seed_salt;
  // What policy seeds are derived from (policy_seed.h).
  std::string policy_seed_secret;
  Budgets budgets;
  nlohmann::json rules;      // the environment's settings, parsed by sim/<track>/
  nlohmann::json scoring;    // judging and boards, parsed by scoring/<track>/
  nlohmann::json effective;  // the whole effective config as a canonical JSON value
  std::string hash;          // SHA-256 (hex) of CanonicalJson(effective)
};

// Parses an effective config (from TrackConfig::effective or a lease order). Unknown keys and
// values out of range are errors.
absl::StatusOr<TrackConfig> ParseTrackConfig(const nlohmann::json& effective,
                                             const std::string& where);

// Loads `track` (a name, looked up as DIR/NAME.json) in `profile` ("" = the
// config's default_profile), resolves "extends" and the profile, and parses.
absl::StatusOr<TrackConfig> LoadTrackConfig(const std::string& tracks_dir,
                                            const std::string& track,
                                            const std::string& profile);

// The same for a config file that a client sent, with the content `file`, in place of the track's own.
// What it "extends", which may be `track` itself, is looked up in `tracks_dir`. `where` names it in
// errors.
absl::StatusOr<TrackConfig> ResolveTrackConfig(const std::string& tracks_dir,
                                               const std::string& track,
                                               const std::string& profile,
                                               const nlohmann::json& file,
                                               const std::string& where);

// The seeds of a config or of a participant's seed file: {"first": N, "count": K} or a list of 1 to
// kMaxEpisodes distinct whole numbers from 0 to 2^63 - 1.
inline constexpr int64_t kMaxEpisodes = 10000;
absl::StatusOr<std::vector<uint64_t>> ParseSeeds(const nlohmann::json& json,
                                                 const std::string& where);

// The same config with other seeds (a practice run): effective config and hash change with them,
// the policy seed of an index does not. Errors as ParseSeeds.
absl::StatusOr<TrackConfig> WithSeeds(const TrackConfig& config,
                                      const std::vector<uint64_t>& seeds);

// InvalidArgumentError if a submission asks for extra observations and the profile has none for it.
absl::Status CheckExtraObservations(bool asked, const TrackConfig& config);

// Whether a submission is shown extra observations: it asks for them, or an adapter, which takes
// what there is, stands between it and the grader.
bool ShowsExtraObservations(bool asked, bool adapted, const TrackConfig& config);

// The config of a challenge's phase: `keys` ("phase", "seeds", "policy_seed_secret", "seed_salt",
// "scoring") are merged over it. Errors as ParseTrackConfig.
absl::StatusOr<TrackConfig> WithPhase(const TrackConfig& config, const nlohmann::json& keys);

// All rules profiles of `track`; errors as LoadTrackConfig.
struct TrackProfiles {
  std::string default_profile;
  std::map<std::string, TrackConfig> configs;
};
absl::StatusOr<TrackProfiles> LoadProfiles(const std::string& tracks_dir, const std::string& track);

// Names of configs and profiles: 1 to 64 of a-z, 0-9 and "-", so that they are safe in paths.
bool IsTrackName(std::string_view name);
// InvalidArgumentError, with what the name is for, unless it is one.
absl::Status CheckTrackName(const std::string& what, const std::string& name);

// Removes keys that begin with "//", which are comments: with them, a config's hash would depend on
// their wording.
void RemoveComments(nlohmann::json& value);

// The names of the configs in a folder, sorted.
absl::StatusOr<std::vector<std::string>> ListTracks(const std::string& tracks_dir);

}  // namespace myograde
