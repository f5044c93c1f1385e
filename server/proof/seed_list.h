// Seed lists that are committed to before anyone can know them: a list is derived from the
// organiser's secret. The SHA-256 hashes of the secret and of the list are published when a phase
// opens, the secret itself when it closes.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>

namespace myograde::server {

inline constexpr size_t kSeedSecretBytes = 32;

// The secret that `text` has in hexadecimal digits, with white space around it at most; `where`
// names it in errors.
absl::StatusOr<std::string> SecretOfDigits(std::string_view text, const std::string& where);

// SHA-256 over the secret's hexadecimal digits, so that `sha256sum` of them agrees.
std::string SecretCommitment(const std::string& secret);

// The seeds of `phase`, a name of 1 to 64 bytes that distinguishes its list from those of other
// phases with the same secret. Candidate N, from 0 on, is the last 63 bits of HMAC-SHA256(secret,
// "myograde seeds/PHASE/N"); duplicates are skipped. REQUIRES: 1 <= count <= kMaxEpisodes.
std::vector<uint64_t> DeriveSeeds(const std::string& secret, const std::string& phase,
                                  int64_t count);

// SHA-256 over the canonical JSON of the list: `hashes.seeds` of results.
std::string SeedListHash(const std::vector<uint64_t>& seeds);

}  // namespace myograde::server
