#include "protocol/packed_log.h"

#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <functional>
#include <memory>
#include <optional>

#include <absl/strings/str_cat.h>

#include "protocol/episode_log.h"

namespace myograde {
namespace {

constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";
constexpr size_t kPieceBytes = 64 << 10;
// 32 MiB of what was unpacked last may be referred to; the simulator's packer takes 2 MiB.
constexpr int kMaxWindowLog = 25;

// Takes a log piece by piece, and no more of it than it can have.
class Collector {
 public:
  absl::Status Take(std::string_view piece) {
    log_.append(piece);
    if (!limit_.has_value()) {
      absl::StatusOr<std::optional<int64_t>> limit = LogBytesLimit(log_);
      if (!limit.ok()) return limit.status();
      if (limit->has_value()) limit_ = std::min(**limit, kMaxLogBytes);
    }
    if (limit_.has_value() && std::ssize(log_) > *limit_) {
      return absl::DataLossError(
          absl::StrCat("the log is larger than the ", *limit_, " bytes that an episode of its "
                       "track can have; it was altered, or is none"));
    }
    return absl::OkStatus();
  }
  std::string Finish() { return std::move(log_); }

 private:
  std::string log_;
  std::optional<int64_t> limit_;  // unknown until the header is there
};

class Unpacker {
 public:
  explicit Unpacker(Collector& collector)
      : collector_(collector), context_(ZSTD_createDCtx(), ZSTD_freeDCtx),
        block_(ZSTD_DStreamOutSize(), '\0') {
    ZSTD_DCtx_setParameter(context_.get(), ZSTD_d_windowLogMax, kMaxWindowLog);
  }

  absl::Status Take(std::string_view piece) {
    ZSTD_inBuffer in = {piece.data(), piece.size(), 0};
    bool full = true;
    while (in.pos < in.size || full) {
      ZSTD_outBuffer out = {block_.data(), block_.size(), 0};
      left_ = ZSTD_decompressStream(context_.get(), &out, &in);
      if (ZSTD_isError(left_)) {
        return absl::DataLossError(
            absl::StrCat("the log can't be unpacked (", ZSTD_getErrorName(left_),
                         "); the file was altered or damaged"));
      }
      if (absl::Status status = collector_.Take({block_.data(), out.pos}); !status.ok()) {
        return status;
      }
      full = out.pos == out.size && left_ != 0;  // more may come of what was taken
    }
    return absl::OkStatus();
  }
  // Nothing is to come.
  absl::Status End() const {
    if (left_ == 0) return absl::OkStatus();
    return absl::DataLossError("the log can't be unpacked: the file is cut");
  }

 private:
  Collector& collector_;
  const std::unique_ptr<ZSTD_DCtx, size_t (*)(ZSTD_DCtx*)> context_;
  std::string block_;
  size_t left_ = 1;
};

// `next` gives the next piece, "" at the end; all but the last have the magic's length at least.
absl::StatusOr<std::string> Collect(
    const std::function<absl::StatusOr<std::string_view>()>& next) {
  Collector collector;
  std::optional<Unpacker> unpacker;
  for (bool first = true;; first = false) {
    absl::StatusOr<std::string_view> piece = next();
    if (!piece.ok()) return piece.status();
    if (piece->empty()) break;
    if (first && piece->starts_with(kZstdMagic)) unpacker.emplace(collector);
    absl::Status status = unpacker ? unpacker->Take(*piece) : collector.Take(*piece);
    if (!status.ok()) return status;
  }
  if (unpacker) {
    if (absl::Status status = unpacker->End(); !status.ok()) return status;
  }
  return collector.Finish();
}

}  // namespace

absl::StatusOr<std::string> ReadPackedLog(int fd) {
  std::string buffer(kPieceBytes, '\0');
  return Collect([&]() -> absl::StatusOr<std::string_view> {
    size_t size = 0;
    while (size < buffer.size()) {
      const ssize_t n = read(fd, buffer.data() + size, buffer.size() - size);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) {
        return absl::DataLossError(absl::StrCat("the log can't be read: ", std::strerror(errno)));
      }
      if (n == 0) break;
      size += static_cast<size_t>(n);
    }
    return std::string_view(buffer).substr(0, size);
  });
}

absl::StatusOr<std::string> UnpackLog(std::string_view packed) {
  return Collect([&]() -> absl::StatusOr<std::string_view> {
    const std::string_view piece = packed.substr(0, kPieceBytes);
    packed.remove_prefix(piece.size());
    return piece;
  });
}

}  // namespace myograde
