#include "server/base/random_bytes.h"

#include <openssl/rand.h>

namespace myograde::server {

absl::StatusOr<std::string> RandomBytes(size_t size) {
  std::string bytes(size, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), static_cast<int>(size)) != 1) {
    return absl::InternalError("this host gives no random bytes");
  }
  return bytes;
}

}  // namespace myograde::server
