#include "server/proof/unpack_log.h"

#include <fcntl.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"

namespace myograde::server {

absl::StatusOr<std::string> ReadLog(const std::string& path) {
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened: ", std::strerror(errno)));
  }
  return ReadPackedLog(file.get());
}

absl::Status CheckLogHash(const std::string& named, const std::string& found) {
  if (named == found) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the log was altered: its SHA-256 is ", found,
                                          ", its record says ", named));
}

}  // namespace myograde::server
