#include "sim/model/file.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>

#include <absl/strings/str_cat.h>

namespace myograde::sim {

absl::StatusOr<std::string> ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(absl::StrCat(path, ": ", std::strerror(errno)));
  std::string text(std::istreambuf_iterator<char>(file), {});
  if (file.bad()) return absl::DataLossError(absl::StrCat(path, ": reading failed"));
  return text;
}

}  // namespace myograde::sim
