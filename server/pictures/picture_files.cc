#include "server/pictures/picture_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <set>
#include <system_error>
#include <tuple>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/file.h"
#include "server/pictures/packing.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kDraft[] = ".draft";

// Endings of names, in the order of PictureKind and of Packing.
constexpr std::array kKindEndings = {".trajectory", ".png", ".glb"};
constexpr std::array kPackingEndings = {"", ".zst", ".gz"};

const char* EndingOf(Packing packing) { return kPackingEndings[static_cast<size_t>(packing)]; }

absl::Status WriteWhole(const std::string& path, std::string_view bytes) {
  const std::string draft = path + kDraft;
  absl::Status written = WriteFile(draft, bytes);
  if (written.ok() && rename(draft.c_str(), path.c_str()) != 0) {
    written = absl::InternalError(std::strerror(errno));
  }
  if (written.ok()) return written;
  unlink(draft.c_str());
  return absl::InternalError(absl::StrCat(path, ": can't be written: ", written.message()));
}

}  // namespace

PictureFiles::PictureFiles(std::string folder, std::function<std::string()> build,
                           int64_t most_bytes)
    : folder_(std::move(folder)), ask_build_(std::move(build)), most_bytes_(most_bytes) {}

const std::string& PictureFiles::Build() const {
  std::call_once(asked_, [this] { build_ = ask_build_(); });
  return build_;
}

void PictureFiles::RemoveDrafts() const {
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    if (entry.path().extension() == kDraft) fs::remove(entry.path(), error);
  }
}

std::string PictureFiles::PathOf(const PictureKey& key, Packing packing) const {
  return absl::StrCat(folder_, "/", key.of, "-", Build(),
                      kKindEndings[static_cast<size_t>(key.kind)], EndingOf(packing));
}

std::optional<PictureFiles::Found> PictureFiles::Find(const PictureKey& key,
                                                      Packing packing) const {
  Found found = {PathOf(key, packing), ""};
  // What is used now is removed last.
  if (utimensat(AT_FDCWD, found.path.c_str(), nullptr, AT_SYMLINK_NOFOLLOW) != 0 &&
      access(found.path.c_str(), R_OK) != 0) {
    return std::nullopt;
  }
  found.tag = absl::StrCat("\"", key.of.substr(0, 64), "-", Build(), EndingOf(packing), "\"");
  return found;
}

bool PictureFiles::Has(const PictureKey& key) const {
  const Packing packing = key.kind == PictureKind::kPicture ? Packing::kPlain : Packing::kZstd;
  return Find(key, packing).has_value();
}

absl::Status PictureFiles::Keep(const PictureKey& key, std::string_view bytes) const {
  absl::Status status;
  if (key.kind == PictureKind::kPicture) {
    status = WriteWhole(PathOf(key, Packing::kPlain), bytes);
  } else {
    status = WriteWhole(PathOf(key, Packing::kGzip), CompressGzip(bytes));
    // The last one, as Has looks for it.
    if (status.ok()) status = WriteWhole(PathOf(key, Packing::kZstd), CompressZstd(bytes));
  }
  Trim();
  return status;
}

void PictureFiles::Trim() const {
  std::set<std::tuple<int64_t, std::string, int64_t>> files;  // when used, in ns; path; bytes
  int64_t sum = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_, error)) {
    struct stat info;
    if (lstat(entry.path().c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    const int64_t used = info.st_mtim.tv_sec * 1'000'000'000 + info.st_mtim.tv_nsec;
    files.emplace(used, entry.path(), info.st_size);
    sum += info.st_size;
  }
  for (const auto& [used, path, bytes] : files) {
    if (sum <= most_bytes_) return;
    if (unlink(path.c_str()) == 0) {
      sum -= bytes;
    } else {
      spdlog::warn("{}: can't be removed: {}", path, std::strerror(errno));
    }
  }
}

}  // namespace myograde::server
