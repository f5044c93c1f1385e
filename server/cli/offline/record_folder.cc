#include "server/cli/offline/record_folder.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/cli/base/verbs.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostFiles = 1'000'000;
constexpr size_t kLongestFileName = 200;

bool IsFolder(std::string_view name) {
  return name == "receipts" || name == "configs" || name == "boards" || name == "secrets";
}

bool IsTopFile(std::string_view name) {
  return name == "record.jsonl" || name == "head.json" || name == "key.pem" ||
         name == "withheld.json";
}

absl::Status Stray(const std::string& name, const char* what) {
  return absl::InvalidArgumentError(
      absl::StrCat(Sanitized(name), " ", what,
                   "; \"myograde proof record export\" writes no such file"));
}

}  // namespace

absl::StatusOr<RecordFolder> RecordFolder::Open(const std::string& path) {
  Fd fd(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd.valid()) {
    return absl::NotFoundError(
        absl::StrCat(path, ": can't be opened as a folder (", strerror(errno),
                     "); name the folder that \"myograde proof record export\" wrote"));
  }
  RecordFolder folder(std::move(fd));
  std::error_code error;
  fs::recursive_directory_iterator entries(path, error);
  for (; !error && entries != fs::recursive_directory_iterator(); entries.increment(error)) {
    const fs::file_status status = entries->symlink_status(error);
    if (error) break;
    const std::string name = entries->path().filename().string();
    const bool top = entries.depth() == 0;
    if (top && fs::is_directory(status) && IsFolder(name)) continue;
    const std::string file = entries->path().lexically_relative(path).string();
    if (!fs::is_regular_file(status)) return Stray(file, "is not a regular file");
    // Phases may begin with a hyphen, and so may the file of a secret.
    const bool plain = !name.starts_with('.') && IsSimpleName(name, kLongestFileName, /*any_first=*/true);
    if (top ? !IsTopFile(name) : !plain) {
      return Stray(file, "does not belong in a record");
    }
    if (folder.files_.size() == kMostFiles) {
      return Stray(file, "exceeds the number of files in a record");
    }
    folder.files_.insert(file);
  }
  if (error) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": can't be read: ", error.message()));
  }
  return folder;
}

// Whoever made the folder may exchange its files while it is read: nothing but a plain file is read,
// and nothing is waited for.
absl::StatusOr<Fd> RecordFolder::OpenFile(const std::string& name) const {
  Fd fd(::openat(fd_.get(), name.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(Sanitized(name), " is missing"));
  }
  return fd;
}

absl::StatusOr<std::string> RecordFolder::Read(const std::string& name, int64_t max_bytes) const {
  ASSIGN_OR_RETURN(const Fd fd, OpenFile(name));
  absl::StatusOr<std::string> text = ReadAll(fd.get(), name, static_cast<size_t>(max_bytes));
  if (absl::IsInvalidArgument(text.status())) {
    return absl::InvalidArgumentError(
        absl::StrCat(Sanitized(name), " is too large for such a file"));
  }
  return text;
}

std::set<std::string> RecordFolder::In(std::string_view folder) const {
  std::set<std::string> found;
  for (auto it = files_.lower_bound(std::string(folder));
       it != files_.end() && it->starts_with(folder); ++it) {
    found.insert(*it);
  }
  return found;
}

}  // namespace myograde::server
