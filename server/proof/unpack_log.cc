#include "server/proof/unpack_log.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {

absl::StatusOr<std::string> ReadLog(const std::string& path) {
  ASSIGN_OR_RETURN(const Fd file, OpenToRead(path));
  return ReadPackedLog(file.get());
}

absl::Status CheckLogHash(const std::string& named, const std::string& found) {
  if (named == found) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the log was altered: its SHA-256 is ", found,
                                          ", its record says ", named));
}

}  // namespace myograde::server
