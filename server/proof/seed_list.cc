#include "server/proof/seed_list.h"

#include <set>

#include <absl/strings/ascii.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/lease/policy_seed.h"

namespace myograde::server {

absl::StatusOr<std::string> SecretOfDigits(std::string_view text, const std::string& where) {
  const std::string digits =
      absl::AsciiStrToLower(absl::StripAsciiWhitespace({text.data(), text.size()}));
  if (digits.size() != 2 * kSeedSecretBytes ||
      digits.find_first_not_of("0123456789abcdef") != std::string::npos) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, ": a secret is ", 2 * kSeedSecretBytes, " hexadecimal digits"));
  }
  return absl::HexStringToBytes(digits);
}

std::string SecretCommitment(const std::string& secret) {
  return Sha256Hex(absl::BytesToHexString(secret));
}

std::vector<uint64_t> DeriveSeeds(const std::string& secret, const std::string& phase,
                                  int64_t count) {
  std::vector<uint64_t> seeds;
  std::set<uint64_t> seen;
  for (int64_t candidate = 0; std::ssize(seeds) < count; ++candidate) {
    const uint64_t seed = SeedOf(secret, absl::StrCat("myograde seeds/", phase, "/", candidate));
    if (seen.insert(seed).second) seeds.push_back(seed);
  }
  return seeds;
}

std::string SeedListHash(const std::vector<uint64_t>& seeds) {
  return Sha256Hex(CanonicalJson(nlohmann::json(seeds)));
}

}  // namespace myograde::server
