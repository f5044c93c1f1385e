#include "server/proof/unpack_log.h"

#include <fcntl.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/sha256.h"

namespace myograde::server {

absl::StatusOr<std::string> ReadLog(const std::string& path) {
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", std::strerror(errno)));
  }
  return ReadPackedLog(file.get());
}

absl::StatusOr<std::string> UnpackLogOf(const std::string& sha256, std::string_view packed) {
  absl::StatusOr<std::string> log = UnpackLog(packed);
  if (log.ok() && Sha256Hex(*log) != sha256) {
    return absl::DataLossError(absl::StrCat("the log was altered: its SHA-256 is ",
                                            Sha256Hex(*log), ", its record says ", sha256));
  }
  return log;
}

}  // namespace myograde::server
