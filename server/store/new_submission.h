// What Writer::Accept takes.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/status.h>

#include "server/store/accepted.h"

namespace myograde::server {

// Who becomes a team's first member.
struct Founding {
  std::string person;    // "uid 1000"
  int64_t most = 1;      // teams that the person may have (Writer::FoundTeam)
  bool needed = true;    // false: it does not matter if the team is somebody else's
};

// A submission to accept. Content that the store already has is shared.
struct NewSubmission {
  std::string team;
  std::string artefact;  // must be in the store
  std::string track;
  std::string profile;
  std::string config;          // hash of `config_json`
  std::string config_json;     // the effective track config, canonical
  std::string seeds;           // hash of `seeds_json`
  std::string seeds_json;      // array of numbers, canonical
  int64_t seed_count = 0;
  bool ranked = false;
  std::string grader_json;
  std::vector<std::pair<int64_t, int64_t>> blocks;  // first and last episode of each lease
  RequestKey request_key = {};
  std::optional<Founding> founding = std::nullopt;  // of its team, in the same change
  std::string phase = "";  // of a challenge; "": the track's own board
  bool extra_observations = false;  // its policy is shown them
  // Why nothing new is accepted; OkStatus(): it is. The ranked evaluation that an artefact has
  // already is found all the same.
  absl::Status closed = absl::OkStatus();
};

}  // namespace myograde::server
