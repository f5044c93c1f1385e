#include "server/proof/seed_list.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>

#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"

namespace myograde::server {

absl::StatusOr<std::string> NewSeedSecret() {
  std::string secret(kSeedSecretBytes, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(secret.data()),
                 static_cast<int>(secret.size())) != 1) {
    return absl::InternalError("this host gives no random bytes");
  }
  return secret;
}

std::vector<uint64_t> DeriveSeeds(const std::string& secret, const std::string& phase,
                                  int64_t count) {
  std::vector<uint64_t> seeds;
  std::set<uint64_t> seen;
  for (int64_t candidate = 0; std::ssize(seeds) < count; ++candidate) {
    const std::string message = absl::StrCat("myograde seeds/", phase, "/", candidate);
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned int size = 0;
    HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
         reinterpret_cast<const unsigned char*>(message.data()), message.size(), digest, &size);
    uint64_t seed = 0;
    for (unsigned i = size - 8; i < size; ++i) seed = seed << 8 | digest[i];
    seed &= ~uint64_t{0} >> 1;
    if (seen.insert(seed).second) seeds.push_back(seed);
  }
  return seeds;
}

std::string SeedListHash(const std::vector<uint64_t>& seeds) {
  return Sha256Hex(CanonicalJson(nlohmann::json(seeds)));
}

}  // namespace myograde::server
