// Challenge files as an organiser may write them. An accepted one keeps every limit, and its phases
// can be played and are in a state at any time.
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "server/challenge/phases.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

namespace {

const Tracks& ShippedTracksForChallenges() {
  static const absl::StatusOr<Tracks> tracks = Tracks::Load(MYOGRADE_SOURCE_DIR "/configs/tracks");
  Require(tracks.ok(), "the shipped tracks load");
  return *tracks;
}

void CheckPhase(const PhaseConfig& phase) {
  Require(IsTrackName(phase.name) && !phase.title.empty(), "a phase has a name and a title");
  Require(phase.seeds.empty() || phase.committed == 0, "seeds are public or committed");
  Require(phase.seeds.size() <= static_cast<size_t>(kMaxEpisodes) &&
              phase.committed >= 0 && phase.committed <= kMaxEpisodes,
          "a phase has a limited number of seeds");
  for (const auto& units : {phase.quota.official_per_day, phase.quota.official_total,
                            phase.quota.failed_per_day, phase.quota.failed_total,
                            phase.quota.waiting}) {
    Require(!units || (*units >= 1 && *units <= kMostUnits), "a quota is a limit");
  }
  for (const absl::Time now : {absl::InfinitePast(), absl::FromUnixSeconds(1'800'000'000),
                               absl::InfiniteFuture()}) {
    const PhaseState state = StatusOfPhase(phase, {}, now).state;
    Require(CheckOpen(phase, now).ok() == (state == PhaseState::kOpen), "a phase is open or not");
  }
}

void CheckPlayed(const ChallengeConfig& challenge) {
  const absl::StatusOr<Phases> phases =
      Phases::Make({challenge}, ShippedTracksForChallenges(),
                   [](const PhaseConfig&) { return std::string(32, 's'); });
  Require(phases.ok() && phases->any(), "a challenge without a mistake can be held");
  Require(phases->entries().size() == challenge.phases.size(), "every phase can be played");
  for (const PhasePtr& phase : phases->entries()) {
    Require(phase->track->config.phase == phase->config.name, "a phase's config names it");
    Require(phases->Find(phase->config.name).ok(), "a phase is found");
    Require(HasPhases(*phases, phase->config.track), "its track has phases");
  }
}

}  // namespace

MYOGRADE_FUZZ_TARGET(challenge)(const uint8_t* data, size_t size) {
  const absl::StatusOr<nlohmann::json> json =
      ParseJson({reinterpret_cast<const char*>(data), size}, "cup.json");
  if (!json.ok()) return 0;
  std::vector<std::string> mistakes;
  const ChallengeConfig challenge = ReadChallenge(*json, "cup", "cup.json", mistakes);
  for (const std::string& mistake : mistakes) {
    Require(mistake.starts_with("cup.json") && mistake.size() < 20'000, "a mistake is one sentence");
  }
  for (const PhaseConfig& phase : challenge.phases) CheckPhase(phase);
  const ChallengeFindings found =
      CheckChallenges({challenge}, ShippedTracksForChallenges(), absl::InfinitePast());
  if (mistakes.empty() && found.mistakes.empty()) CheckPlayed(challenge);
  return 0;
}
