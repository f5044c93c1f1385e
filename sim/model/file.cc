#include "sim/model/file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"

namespace myograde::sim {

absl::StatusOr<MappedFile> MappedFile::Open(const std::string& path) {
  const Fd file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) return absl::NotFoundError(absl::StrCat(path, ": ", std::strerror(errno)));
  struct stat about = {};
  if (fstat(file.get(), &about) != 0) {
    return absl::DataLossError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  const auto size = static_cast<size_t>(about.st_size);
  if (size == 0) return MappedFile({});
  void* start = mmap(nullptr, size, PROT_READ, MAP_PRIVATE | MAP_POPULATE, file.get(), 0);
  if (start == MAP_FAILED) {
    return absl::DataLossError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  return MappedFile({static_cast<const char*>(start), size});
}

MappedFile::~MappedFile() {
  if (!content_.empty()) munmap(const_cast<char*>(content_.data()), content_.size());
}

}  // namespace myograde::sim
