#include "server/http/body.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr int64_t kReserveStep = 4 << 20;  // of a body that has any length
constexpr int64_t kLookAtDisk = 16 << 20;  // written between two looks at what is free

absl::Status WriteToDisk(int fd, std::string_view bytes) {
  const absl::Status status = WriteAll(fd, bytes);
  if (status.ok()) return status;
  return absl::Status(status.code(), "the server's disk does not take the request");
}

absl::StatusOr<Fd> NewFile(const std::string& path) {
  Fd fd(::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!fd.valid()) return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be created"));
  return fd;
}

ApiError StoreError(const absl::Status& status) {
  return {503, "store", std::string(status.message())};
}

}  // namespace

std::optional<ApiError> Spool::Reserve(PeerLoad& peer, int64_t bytes) {
  const MutexLock lock(mutex_);
  if (bytes > of_a_peer_ - peer.spooled) {
    return ApiError{429, "too_many",
                    "what you are sending at once is more than one sender may; let other uploads of "
                    "yours end first"};
  }
  if (bytes > total_ - taken_) {
    return ApiError{429, "too_many",
                    "the server is receiving as much as it can store; try again in a few minutes"};
  }
  peer.spooled += bytes;
  taken_ += bytes;
  return std::nullopt;
}

void Spool::Release(PeerLoad& peer, int64_t bytes) {
  const MutexLock lock(mutex_);
  peer.spooled -= bytes;
  taken_ -= bytes;
}

std::optional<ApiError> Spool::CheckDisk(int64_t bytes) const {
  std::error_code error;
  const std::filesystem::space_info disk = std::filesystem::space(folder_, error);
  if (error) {
    return ApiError{503, "store",
                    "the server's folder for uploads can't be examined; tell the organisers"};
  }
  if (static_cast<int64_t>(disk.available) - bytes >= disk_reserve_) return std::nullopt;
  return ApiError{503, "store",
                  "the server's disk is too full for this; try again later, or tell the "
                  "organisers"};
}

std::string Spool::NewPath() { return absl::StrCat(folder_, "/body-", ++names_); }

absl::StatusOr<std::string> Body::Text() const {
  if (!spooled()) return memory_;
  absl::StatusOr<std::string> text = ReadFile(path_);
  if (text.ok() && std::ssize(*text) == size_) return text;
  return absl::UnavailableError("a request can't be read back from the server's disk");
}

ssize_t Body::ReadAt(char* to, size_t size, int64_t offset) const {
  if (spooled()) return ::pread(file_.get(), to, size, static_cast<off_t>(offset));
  return static_cast<ssize_t>(memory_.copy(to, size, static_cast<size_t>(offset)));
}

absl::Status Body::MoveTo(const std::string& path) {
  if (!spooled()) {
    ASSIGN_OR_RETURN(const Fd fd, NewFile(path));
    const absl::Status written = WriteToDisk(fd.get(), memory_);
    if (!written.ok()) ::unlink(path.c_str());
    return written;
  }
  if (::rename(path_.c_str(), path.c_str()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrCat(path, ": can't be created"));
  }
  path_.clear();
  Drop();
  return absl::OkStatus();
}

std::optional<ApiError> Body::Reserve(int64_t bytes) {
  if (std::optional<ApiError> full = spool_.Reserve(peer_, bytes)) return full;
  reserved_ += bytes;
  return std::nullopt;
}

std::optional<ApiError> Body::OpenFile() {
  const std::string path = spool_.NewPath();
  absl::StatusOr<Fd> file = NewFile(path);
  if (!file.ok()) return StoreError(file.status());
  file_ = *std::move(file);
  path_ = path;
  const absl::Status written = WriteToDisk(file_.get(), memory_);
  memory_ = std::string();
  if (!written.ok()) return StoreError(written);
  return std::nullopt;
}

std::optional<ApiError> Body::Write(std::string_view bytes) {
  const int64_t after = size_ + std::ssize(bytes);
  if (after > reserved_) {
    if (auto full = Reserve(std::max(kReserveStep, after - reserved_))) return full;
  }
  if (!spooled() || size_ / kLookAtDisk != after / kLookAtDisk) {
    if (auto full = spool_.CheckDisk(reserved_ - size_)) return full;
  }
  if (!spooled()) {
    if (auto error = OpenFile()) return error;
  }
  size_ = after;
  if (const absl::Status written = WriteToDisk(file_.get(), bytes); !written.ok()) {
    return StoreError(written);
  }
  return std::nullopt;
}

void Body::Drop() {
  if (spooled()) ::unlink(path_.c_str());
  path_.clear();
  memory_ = std::string();
  file_.reset();
  size_ = 0;
  if (reserved_ > 0) spool_.Release(peer_, reserved_);
  reserved_ = 0;
}

}  // namespace myograde::server
