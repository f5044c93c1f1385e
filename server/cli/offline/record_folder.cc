#include "server/cli/offline/record_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#include <absl/cleanup/cleanup.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/cli/terminal/terminal.h"

namespace myograde::server {
namespace {

constexpr size_t kMostFiles = 1'000'000;
constexpr size_t kReadAtOnce = 1u << 20;

bool IsFolder(std::string_view name) {
  return name == "receipts" || name == "configs" || name == "boards" || name == "secrets";
}

bool IsTopFile(std::string_view name) {
  return name == "record.jsonl" || name == "head.json" || name == "key.pem" ||
         name == "withheld.json";
}

// Letters, digits, and what the names of boards, phases and hashes have.
bool IsPlainName(std::string_view name) {
  return !name.empty() && name.size() <= 200 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '-' || c == '_';
         });
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
  RETURN_IF_ERROR(folder.List("", 0));
  return folder;
}

absl::Status RecordFolder::List(const std::string& folder, int depth) {
  const int fd = ::openat(fd_.get(), folder.empty() ? "." : folder.c_str(),
                          O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  DIR* dir = fd < 0 ? nullptr : ::fdopendir(fd);
  if (dir == nullptr) return Stray(folder, "can't be opened as a folder");
  const absl::Cleanup close = [dir] { ::closedir(dir); };
  while (const dirent* entry = ::readdir(dir)) {
    const std::string name = entry->d_name;
    if (name == "." || name == "..") continue;
    const std::string path = absl::StrCat(folder, folder.empty() ? "" : "/", name);
    struct stat info = {};
    if (::fstatat(fd_.get(), path.c_str(), &info, AT_SYMLINK_NOFOLLOW) != 0) {
      return Stray(path, "can't be read");
    }
    if (depth == 0 && S_ISDIR(info.st_mode) && IsFolder(name)) {
      RETURN_IF_ERROR(List(name, 1));
      continue;
    }
    if (!S_ISREG(info.st_mode)) return Stray(path, "is not a regular file");
    if (depth == 0 ? !IsTopFile(name) : !IsPlainName(name)) {
      return Stray(path, "does not belong in a record");
    }
    if (files_.size() == kMostFiles) return Stray(path, "exceeds the number of files in a record");
    files_.insert(path);
  }
  return absl::OkStatus();
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

absl::Status RecordFolder::ForEachLine(
    const std::string& name, int64_t max_bytes,
    const std::function<absl::Status(std::string_view line)>& on_line) const {
  ASSIGN_OR_RETURN(const Fd fd, OpenFile(name));
  std::vector<char> buffer(kReadAtOnce);
  std::string line;
  for (;;) {
    const ssize_t got = ::read(fd.get(), buffer.data(), buffer.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return absl::UnavailableError(absl::StrCat(Sanitized(name), ": can't be read"));
    if (got == 0) break;
    std::string_view rest(buffer.data(), static_cast<size_t>(got));
    for (size_t end; (end = rest.find('\n')) != std::string_view::npos;) {
      line.append(rest.substr(0, end));
      if (std::ssize(line) > max_bytes) break;
      RETURN_IF_ERROR(on_line(line));
      line.clear();
      rest.remove_prefix(end + 1);
    }
    line.append(rest);
    if (std::ssize(line) > max_bytes) {
      return absl::InvalidArgumentError(
          absl::StrCat(Sanitized(name), " has a line longer than any entry"));
    }
  }
  if (line.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(Sanitized(name), " ends in the middle of a line"));
}

}  // namespace myograde::server
