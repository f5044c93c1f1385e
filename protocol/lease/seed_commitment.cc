#include "protocol/lease/seed_commitment.h"

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/lease/policy_seed.h"

namespace myograde {

PhaseSecrets SecretsOfPhase(const std::string& secret, const std::string& phase) {
  const auto derived = [&](const char* what) {
    return absl::BytesToHexString(HmacSha256(secret, absl::StrCat("myograde ", what, "/", phase)));
  };
  return {.policy_seed_secret = derived("policy seeds"), .seed_salt = derived("seed salt")};
}

std::string SeedCommitment(const std::string& seed_salt, int64_t index, uint64_t seed) {
  return absl::BytesToHexString(HmacSha256(seed_salt, absl::StrCat(index, "/", seed)));
}

}  // namespace myograde
