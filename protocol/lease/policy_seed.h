// The seed of a policy's own randomness, one for each episode of an evaluation.
//
// It is derived from the track config's "policy_seed_secret" and the episode's index alone, so all
// teams get the same luck in every data folder and in local runs, and changing a byte of a
// submission draws no new seed. The secret is as public as the seeds beside it.
#pragma once

#include <cstdint>
#include <string>

#include "protocol/lease/track_config.h"

namespace myograde {

// What policy seeds under configs of form 1 are derived from: a secret of the data folder and the
// artefact's hash.
struct Form1PolicySeeds {
  std::string host_secret;
  std::string artefact;
};

// HMAC-SHA256 over `message`, keyed with `key`: 32 bytes.
std::string HmacSha256(const std::string& key, const std::string& message);

// The last 8 bytes (big endian, without their highest bit) of HMAC-SHA256 over `message`, keyed
// with `key`.
uint64_t SeedOf(const std::string& key, const std::string& message);

// The seed of "myograde policy seed/INDEX", keyed with `secret`. `episode` is the index in the
// evaluation's list of seeds, from 0.
uint64_t PolicySeed(const std::string& secret, int64_t episode);

// The policy seed of an episode under `config`: derived from its secret, or, for form 1, that of
// "ARTEFACT/INDEX", keyed with the host's secret.
uint64_t PolicySeed(const TrackConfig& config, const Form1PolicySeeds& form1, int64_t episode);

}  // namespace myograde
