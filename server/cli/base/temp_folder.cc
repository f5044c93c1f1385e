#include "server/cli/base/temp_folder.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include <absl/strings/str_cat.h>

namespace myograde::server {

absl::StatusOr<TempFolder> TempFolder::Make(const std::string& purpose) {
  std::error_code error;
  const std::filesystem::path base = std::filesystem::temp_directory_path(error);
  std::string name = (base / absl::StrCat("myograde-", purpose, ".XXXXXX")).string();
  if (error || ::mkdtemp(name.data()) == nullptr) {
    return absl::InternalError(absl::StrCat(
        "can't make a temporary folder in ", base.string(), ": ",
        error ? error.message() : std::strerror(errno), "; set TMPDIR to a folder with space"));
  }
  return TempFolder(name);
}

TempFolder::~TempFolder() {
  if (path_.empty()) return;
  std::error_code ignored;  // nobody is left to tell
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace myograde::server
