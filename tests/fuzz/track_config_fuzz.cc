// Track configs as an organiser may write them. Each input is a file that may extend the shipped
// ones; an accepted config has limits above zero, and its effective form is accepted again with the
// same hash.
#include "protocol/base/config_reader.h"
#include "protocol/lease/track_config.h"
#include "server/grading/tracks.h"
#include "sim/tracks.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

// Comments only make every round slower.
void DropComments(nlohmann::json& value) {
  for (auto it = value.begin(); value.is_structured() && it != value.end();) {
    if (value.is_object() && it.key().starts_with("//")) {
      it = value.erase(it);
      continue;
    }
    DropComments(*it);
    ++it;
  }
}

// A folder with the shipped configs, to which the input is added as fuzzed.json.
const fuzz::Folder& TracksFolder() {
  static const fuzz::Folder folder;
  static const bool filled = [] {
    for (const char* name : {"manipulation", "locomotion"}) {
      const std::string file = std::string(name) + ".json";
      auto json = ReadJsonFile(MYOGRADE_SOURCE_DIR "/configs/tracks/" + file);
      Require(json.ok(), "a shipped config is JSON");
      DropComments(*json);
      fuzz::WriteFile(folder / file, CanonicalJson(*json));
    }
    return true;
  }();
  Require(filled, "the shipped configs are there");
  return folder;
}

void CheckBudgets(const Budgets& b) {
  for (const double limit : {b.startup_s, b.startup_wall_s, b.step_s, b.overtime_s, b.wall_factor,
                             b.lease_cpu_s, b.lease_wall_s, b.lease_idle_s, b.cpus}) {
    Require(limit > 0 && limit < 1e9, "a budget of time is a limit");
  }
  for (const int64_t limit :
       {b.memory_bytes, b.tasks, b.scratch_bytes, b.scratch_files, b.output_bytes, b.open_files,
        b.stray_messages, b.wrong_answers, b.restarts, b.submission_bytes, b.submission_files}) {
    Require(limit > 0 && limit <= int64_t{1} << 40, "a budget is a limit");
  }
}

}  // namespace

MYOGRADE_FUZZ_TARGET(track_config)(const uint8_t* data, size_t size) {
  fuzz::WriteFile(TracksFolder() / "fuzzed.json", {reinterpret_cast<const char*>(data), size});
  const std::string folder = TracksFolder().path().string();
  const absl::StatusOr<TrackConfig> config = LoadTrackConfig(folder, "fuzzed", "");
  if (!config.ok()) {
    Require(config.status().message().size() < 20'000, "a refusal is bearable");
    return 0;
  }
  // Another profile may hold a mistake.
  if (const auto profiles = LoadProfiles(folder, "fuzzed"); profiles.ok()) {
    Require(profiles->default_profile == config->profile, "without a name, the default is meant");
    Require(profiles->configs.at(config->profile).hash == config->hash, "a profile is one config");
  }
  CheckBudgets(config->budgets);
  Require(!config->seeds.empty() && config->seeds.size() <= static_cast<size_t>(kMaxEpisodes),
          "there are seeds");
  Require(config->episodes_per_lease >= 1, "a lease has episodes");
  const absl::StatusOr<TrackConfig> again = ParseTrackConfig(config->effective, "again");
  Require(again.ok() && again->hash == config->hash, "the effective config is one of its own");
  (void)server::MakeTrack(*config);
  (void)config->kind->max_steps(config->rules);
  // Parses the rules; there are no models to load.
  (void)sim::MakeEnvironment(*config, "/nowhere");
  return 0;
}
