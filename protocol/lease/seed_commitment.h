// Commitments to the seeds of a phase that hides them. A row that may be shown before the phase
// reveals its seeds holds the commitment in place of the seed: nobody can find the seed from it, as
// the salt is unknown, and nobody can put another seed in its place afterwards.
#pragma once

#include <cstdint>
#include <string>

namespace myograde {

// What a phase's config holds besides its seeds, derived from the phase's secret (32 bytes).
struct PhaseSecrets {
  std::string policy_seed_secret;  // HMAC-SHA256(secret, "myograde policy seeds/PHASE"), in hexadecimal
  std::string seed_salt;           // HMAC-SHA256(secret, "myograde seed salt/PHASE"), in hexadecimal
};
PhaseSecrets SecretsOfPhase(const std::string& secret, const std::string& phase);

// HMAC-SHA256 of "INDEX/SEED", keyed with the text of the salt, in hexadecimal. `index` is the
// episode's, from 0.
std::string SeedCommitment(const std::string& seed_salt, int64_t index, uint64_t seed);

}  // namespace myograde
