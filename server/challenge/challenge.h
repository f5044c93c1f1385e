// Challenges: configs/challenges/NAME.json, parsed and checked. A challenge has phases; each phase is
// a track with seeds, times and rules of its own, and has boards of its own. Without any challenge,
// each track is open, on its own seeds. Pure.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "scoring/board.h"
#include "scoring/statistics_config.h"
#include "server/access/access.h"
#include "server/challenge/offered_tracks.h"
#include "server/store/store.h"

namespace myograde::server {

// The quota of a phase: keys of "quota" of server.json, whose values apply where one is nullopt.
struct PhaseQuota {
  std::optional<int64_t> official_per_day;
  std::optional<int64_t> official_total;
  std::optional<int64_t> failed_per_day;
  std::optional<int64_t> failed_total;
  std::optional<int64_t> waiting;
  std::optional<bool> one_for_everyone;  // AdmissionRules::one_for_everyone
};

struct PhaseConfig {
  std::string name;        // unique among all challenges of a server; IsTrackName
  std::string challenge;   // the name of its challenge
  std::string title;       // one line of text
  std::string track;       // a track config, and one of its profiles
  std::string profile;
  // Exactly one of these is set; neither: the track's own seeds.
  std::vector<uint64_t> seeds;   // a public list
  int64_t committed = 0;         // so many hidden seeds, derived from the phase's secret
  absl::Time opens = absl::InfinitePast();
  absl::Time closes = absl::InfiniteFuture();
  // From here on others see the board as it was, until the phase is published.
  absl::Time freezes = absl::InfiniteFuture();
  std::optional<scoring::TeamRule> entry;  // nullopt: the track's
  // The teams that may submit, by any of their names; empty: every team.
  std::vector<std::string> teams = {};
  PhaseQuota quota;
  Visibility shown;             // while the phase is not published
  bool public_replay = false;   // IsReplayPublic: its organiser allows it
  // Keys of "statistics" of server.json, whose values apply where one is missing; checked over the
  // usual ones.
  nlohmann::json statistics = nlohmann::json::object();
};

struct ChallengeConfig {
  std::string name;   // of its file
  std::string where;  // the file, for messages
  std::string title;
  nlohmann::json text = nlohmann::json::array();  // what its host says on the first page: MarkdownTree
  std::string logo = {};  // a PNG; "": none
  std::vector<PhaseConfig> phases;
};

inline constexpr size_t kMaxPhases = 100;  // of a challenge
inline constexpr size_t kMaxTitleBytes = 200;

// Reads a challenge file. `where` names it in mistakes: sentences with file, phase and key, which are
// added to `mistakes`. A phase with a mistake is left out.
ChallengeConfig ReadChallenge(const nlohmann::json& json, const std::string& name,
                              const std::string& where, std::vector<std::string>& mistakes);

// Sets `text` and `logo` to what NAME.md and NAME.png beside the challenge file NAME.json have, if there are such files.
void ReadChallengeText(const std::string& file, ChallengeConfig& challenge,
                       std::vector<std::string>& mistakes);

// Reads every challenge of a folder, by name; none if there is no such folder. Mistakes include files
// that can't be read and names that no challenge may have.
std::vector<ChallengeConfig> ReadChallenges(const std::string& dir,
                                            std::vector<std::string>& mistakes);

struct ChallengeFindings {
  std::vector<std::string> mistakes;  // a server with one does not start
  std::vector<std::string> warnings;  // what is allowed, and probably not meant
};

// Checks all challenges of a server together. Each finding is one sentence with the file, the phase
// and what to do. `now`: what is in the past gets a warning; InfinitePast() for none.
ChallengeFindings CheckChallenges(const std::vector<ChallengeConfig>& challenges,
                                  const Tracks& tracks, absl::Time now);

// One sentence about mistakes, of which there is at least one.
absl::Status MistakesToStatus(const std::vector<std::string>& mistakes);

// The track that a phase plays. `secret`: the phase's 32 bytes, used for committed seeds only.
// Errors as WithPhase and MakeTrack.
absl::StatusOr<TrackPtr> PhaseTrack(const PhaseConfig& phase, const Track& track,
                                    const std::string& secret);

// The keys that `phase` (nullptr: no file describes it any more) gives to the config that it plays;
// all of them are in `live`, which it plays now.
nlohmann::json KeysOfPhase(const PhaseConfig* phase, const TrackConfig& live);

// The rules for submissions to a phase, on a track with the rules `fallback`.
AdmissionRules PhaseRules(const PhaseConfig& phase, AdmissionRules fallback);

// How its board tells close places apart, on a server with `fallback`. InvalidArgumentError: the two
// don't fit together (ParseStatistics).
absl::StatusOr<scoring::StatisticsConfig> PhaseStatistics(const PhaseConfig& phase,
                                                          const scoring::StatisticsConfig& fallback);

// "best", "last" or "chosen".
std::string_view TeamRuleName(scoring::TeamRule rule);

// "2026-12-01T00:00:00Z".
std::string UtcText(absl::Time time);

}  // namespace myograde::server
