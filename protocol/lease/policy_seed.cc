#include "protocol/lease/policy_seed.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <absl/strings/str_cat.h>

namespace myograde {

std::string HmacSha256(const std::string& key, const std::string& message) {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
       reinterpret_cast<const unsigned char*>(message.data()), message.size(), digest, &size);
  return std::string(reinterpret_cast<const char*>(digest), size);
}

uint64_t SeedOf(const std::string& key, const std::string& message) {
  const std::string digest = HmacSha256(key, message);
  uint64_t seed = 0;
  for (size_t i = digest.size() - 8; i < digest.size(); ++i) {
    seed = seed << 8 | static_cast<unsigned char>(digest[i]);
  }
  return seed & (~uint64_t{0} >> 1);
}

uint64_t PolicySeed(const std::string& secret, int64_t episode) {
  return SeedOf(secret, absl::StrCat("myograde policy seed/", episode));
}

}  // namespace myograde
