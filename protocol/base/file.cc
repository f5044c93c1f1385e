#include "protocol/base/file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"

namespace myograde {
namespace {

std::string CantBe(const std::string& path, const char* what) {
  return absl::StrCat(path, ": can't be ", what, ": ", std::strerror(errno));
}

// "" if it can be read like a file.
const char* KindOf(mode_t mode) {
  switch (mode & S_IFMT) {
    case S_IFREG: return "";
    case S_IFDIR: return "a folder";
    case S_IFIFO: return "a named pipe";
    case S_IFSOCK: return "a socket";
    default: return "a device";
  }
}

// An open descriptor by its name: whoever started this process chose what it is.
bool IsInherited(const std::string& path) {
  for (const char* place : {"/dev/stdin", "/dev/fd/", "/proc/self/fd/"}) {
    if (path.starts_with(place)) return true;
  }
  return false;
}

}  // namespace

absl::StatusOr<Fd> OpenToRead(const std::string& path) {
  if (IsInherited(path)) {
    Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (!file.valid()) return absl::NotFoundError(CantBe(path, "read"));
    return file;
  }
  Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.valid()) return absl::NotFoundError(CantBe(path, "read"));
  struct stat info = {};
  if (::fstat(file.get(), &info) != 0) return absl::UnavailableError(CantBe(path, "read"));
  if (const std::string kind = KindOf(info.st_mode); !kind.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": is ", kind, "; it must be a file"));
  }
  return file;
}

absl::StatusOr<std::string> ReadAll(int fd, const std::string& name, size_t max_bytes) {
  // In pieces: a buffer for the largest file costs more than reading the usual one.
  char piece[16 << 10];
  std::string text;
  while (true) {
    const ssize_t n = ::read(fd, piece, sizeof(piece));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return absl::UnavailableError(CantBe(name, "read"));
    if (n == 0) return text;
    text.append(piece, static_cast<size_t>(n));
    if (text.size() > max_bytes) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": is larger than ", max_bytes, " bytes"));
    }
  }
}

absl::Status ForEachLine(
    int fd, const std::string& name, size_t max_line,
    const std::function<absl::Status(std::string_view line, int64_t number)>& on_line) {
  char piece[16 << 10];
  std::string line;
  int64_t number = 1;
  const auto broken = [&](const char* what) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": line ", number, ": ", what,
                                                   "; the file was changed or cut off: export it again"));
  };
  while (true) {
    const ssize_t n = ::read(fd, piece, sizeof(piece));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return absl::UnavailableError(CantBe(name, "read"));
    if (n == 0) return line.empty() ? absl::OkStatus() : broken("ends in the middle");
    std::string_view rest(piece, static_cast<size_t>(n));
    while (!rest.empty()) {
      const size_t end = rest.find('\n');
      line.append(rest.substr(0, end));
      if (line.size() > max_line) return broken("is too long");
      if (end == std::string_view::npos) break;
      RETURN_IF_ERROR(on_line(line, number));
      ++number;
      line.clear();
      rest.remove_prefix(end + 1);
    }
  }
}

absl::StatusOr<std::string> ReadFile(const std::string& path, size_t max_bytes) {
  ASSIGN_OR_RETURN(const Fd file, OpenToRead(path));
  return ReadAll(file.get(), path, max_bytes);
}

absl::Status WriteAll(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t n = ::write(fd, text.data(), text.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return absl::ErrnoToStatus(n == 0 ? EIO : errno, "the disk does not take the file");
    text.remove_prefix(static_cast<size_t>(n));
  }
  return absl::OkStatus();
}

absl::StatusOr<Fd> MakeMemoryFile(const char* name, std::string_view content) {
  const Fd made(::memfd_create(name, MFD_CLOEXEC));
  Fd file(::fcntl(made.get(), F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
  if (file.valid() && WriteAll(file.get(), content).ok() && ::lseek(file.get(), 0, SEEK_SET) == 0) {
    return file;
  }
  return absl::InternalError(absl::StrCat("can't make a memory file: ", std::strerror(errno)));
}

absl::Status WriteFile(const std::string& path, std::string_view text) {
  Fd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666));
  // Some file systems report a full disk only on close.
  if (!file.valid() || !WriteAll(file.get(), text).ok() || ::close(file.release()) != 0) {
    return absl::InvalidArgumentError(CantBe(path, "written"));
  }
  return absl::OkStatus();
}

}  // namespace myograde
