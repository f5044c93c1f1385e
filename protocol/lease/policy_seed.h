// The seed of a policy's own randomness, one for each episode of an evaluation.
//
// It is derived from the track config's "policy_seed_secret" and the episode's index alone, so all
// teams get the same luck in every data folder and in local runs, and changing a byte of a
// submission draws no new seed. The secret is as public as the seeds beside it.
#pragma once

#include <cstdint>
#include <string>

namespace myograde {

// HMAC-SHA256 over `message`, keyed with `key`: 32 bytes.
std::string HmacSha256(const std::string& key, const std::string& message);

// The last 8 bytes (big endian, without their highest bit) of HMAC-SHA256 over `message`, keyed
// with `key`.
uint64_t SeedOf(const std::string& key, const std::string& message);

// The seed of "myograde policy seed/INDEX", keyed with `secret`. `episode` is the index in the
// evaluation's list of seeds, from 0.
uint64_t PolicySeed(const std::string& secret, int64_t episode);

}  // namespace myograde
