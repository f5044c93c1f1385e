#include "server/webhook/signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <array>

#include <absl/strings/str_cat.h>

#include "protocol/base/sha256.h"

namespace myograde::server {

std::string SignatureOf(std::string_view secret, int64_t seconds, std::string_view body) {
  const std::string text = absl::StrCat(seconds, ".", std::string(body));
  std::array<uint8_t, 32> digest = {};
  unsigned size = digest.size();
  HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size);
  return absl::StrCat("t=", seconds, ",v1=", HexOf(digest));
}

}  // namespace myograde::server
