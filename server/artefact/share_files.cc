#include "server/artefact/share_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <functional>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/lease/policy_image.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

constexpr int kMostFolders = 80;  // in each other; unpacking allows fewer
// Smaller files are not shared: each takes one block of the disk, as a name in the pool does.
constexpr int64_t kLeastSharedBytes = 4096;

Fd OpenFolder(int at, const char* name) {
  return Fd(::openat(at, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
}

// Calls `use` with each file at and below a folder, its folder and its name.
void ForEachFile(const Fd& folder, int depth,
                 const std::function<void(int at, const char* name, const struct stat&)>& use) {
  if (!folder.valid() || depth > kMostFolders) return;
  for (const std::string& name : NamesIn(folder.get()).value_or(std::vector<std::string>())) {
    struct stat info = {};
    if (::fstatat(folder.get(), name.c_str(), &info, AT_SYMLINK_NOFOLLOW) != 0) continue;
    if (S_ISDIR(info.st_mode)) {
      ForEachFile(OpenFolder(folder.get(), name.c_str()), depth + 1, use);
    } else if (S_ISREG(info.st_mode)) {
      use(folder.get(), name.c_str(), info);
    }
  }
}

// The name in the pool of an open file; "" if it can't be read.
std::string PoolName(int file, const struct stat& info) {
  FileStream bytes(file);
  int64_t left = INT64_MAX;
  CheckedStream hashed(bytes, "it", left);
  if (!hashed.Finish().ok()) return "";
  return absl::StrCat(hashed.sha256(), (info.st_mode & 0111) != 0 ? "-x-" : "-r-",
                      info.st_mtim.tv_sec);
}

// Replaces one file by the pool's, or gives it to the pool.
void ShareFile(int pool, int at, const char* name, const struct stat& info) {
  static std::atomic<int64_t> numbers = 0;
  if (info.st_size < kLeastSharedBytes || info.st_nlink != 1) return;
  const Fd file(::openat(at, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (!file.valid()) return;
  const std::string pooled = PoolName(file.get(), info);
  if (pooled.empty() || ::linkat(at, name, pool, pooled.c_str(), 0) == 0 || errno != EEXIST) return;
  struct stat known = {};
  if (::fstatat(pool, pooled.c_str(), &known, AT_SYMLINK_NOFOLLOW) != 0 ||
      !S_ISREG(known.st_mode) || known.st_size != info.st_size) {
    return;
  }
  // Under a name of the pool first, as the image may have any other.
  const std::string fresh = absl::StrCat("new-", ::getpid(), "-", ++numbers);
  if (::linkat(pool, pooled.c_str(), pool, fresh.c_str(), 0) != 0) return;  // too many links
  if (::renameat(pool, fresh.c_str(), at, name) != 0) ::unlinkat(pool, fresh.c_str(), 0);
}

}  // namespace

absl::Status ShareImage(const std::string& artefact, const std::string& pool) {
  const Fd folder = OpenFolder(AT_FDCWD, artefact.c_str());
  const Fd image = folder.valid() ? OpenFolder(folder.get(), kImageFolder) : Fd();
  if (!image.valid()) return absl::OkStatus();
  if (::mkdir(pool.c_str(), 0700) != 0 && errno != EEXIST) {
    return HostError(absl::StrCat("can't create the folder ", pool));
  }
  const Fd pooled = OpenFolder(AT_FDCWD, pool.c_str());
  if (!pooled.valid()) return HostError(absl::StrCat("can't open the folder ", pool));
  ForEachFile(image, 0, [&](int at, const char* name, const struct stat& info) {
    ShareFile(pooled.get(), at, name, info);
  });
  return absl::OkStatus();
}

int64_t SweepPool(const std::string& pool) {
  int64_t freed = 0;
  // What is shared at this moment keeps its bytes, and is not in the pool afterwards.
  ForEachFile(OpenFolder(AT_FDCWD, pool.c_str()), 0,
              [&](int at, const char* name, const struct stat& info) {
                if (info.st_nlink == 1 && ::unlinkat(at, name, 0) == 0) freed += info.st_size;
              });
  return freed;
}

int64_t DiskBytes(const std::string& artefact) {
  int64_t bytes = 0;
  ForEachFile(OpenFolder(AT_FDCWD, artefact.c_str()), 0,
              [&](int, const char*, const struct stat& info) {
                // One of the links is the pool's.
                const auto sharers = static_cast<int64_t>(info.st_nlink) - 1;
                bytes += sharers > 1 ? info.st_size / sharers : info.st_size;
              });
  return bytes;
}

}  // namespace myograde::server
