// Challenges: configs/challenges/NAME.json, parsed and checked. A challenge has phases; each phase is
// a track with seeds, times and rules of its own, and has boards of its own. Without any challenge,
// each track is open, on its own seeds. Pure.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "scoring/board.h"
#include "server/access/sight.h"
#include "server/store/quota.h"

namespace myograde::server {

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
  scoring::TeamRule entry = scoring::TeamRule::kBest;
  std::optional<QuotaLimits> quota;  // nullopt: server.json's
  Visibility shown;             // while the phase is not published
};

struct ChallengeConfig {
  std::string name;        // of its file
  std::string title;
  std::vector<PhaseConfig> phases;
};

}  // namespace myograde::server
