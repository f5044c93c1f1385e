#include "protocol/log/packed_log.h"

#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <functional>
#include <memory>
#include <optional>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "protocol/log/episode_log.h"

namespace myograde {
namespace {

constexpr std::string_view kZstdMagic = "\x28\xb5\x2f\xfd";
constexpr size_t kPieceBytes = 64 << 10;
// Back-references may reach 32 MiB; the simulator's packer uses 2 MiB.
constexpr int kMaxWindowLog = 25;

// Passes a log on in pieces, and no more of it than its header allows.
class Bounded {
 public:
  explicit Bounded(LogUnpacker::Sink sink) : sink_(std::move(sink)) {}

  absl::Status Take(std::string_view piece) {
    size_ += std::ssize(piece);
    if (!limit_.has_value()) {
      begin_.append(piece);
      ASSIGN_OR_RETURN(std::optional<int64_t> limit, LogBytesLimit(begin_));
      if (limit.has_value()) {
        limit_ = std::min(*limit, kMaxLogBytes);
        begin_ = std::string();
      }
    }
    if (limit_.has_value() && size_ > *limit_) {
      return absl::DataLossError(
          absl::StrCat("the log is larger than the ", *limit_, " bytes that an episode of its "
                       "track can have; it was altered, or is none"));
    }
    return sink_(piece);
  }

 private:
  const LogUnpacker::Sink sink_;
  std::string begin_;  // until the header is complete
  int64_t size_ = 0;
  std::optional<int64_t> limit_;  // unknown until then
};

class Unpacker {
 public:
  explicit Unpacker(Bounded& log)
      : log_(log), context_(ZSTD_createDCtx(), ZSTD_freeDCtx),
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
      RETURN_IF_ERROR(log_.Take({block_.data(), out.pos}));
      full = out.pos == out.size && left_ != 0;  // more output may be pending
    }
    return absl::OkStatus();
  }
  // The log is complete.
  absl::Status End() const {
    if (left_ == 0) return absl::OkStatus();
    return absl::DataLossError("the log can't be unpacked: the file is cut");
  }

 private:
  Bounded& log_;
  const std::unique_ptr<ZSTD_DCtx, size_t (*)(ZSTD_DCtx*)> context_;
  std::string block_;
  size_t left_ = 1;
};

}  // namespace

class LogUnpacker::Impl {
 public:
  explicit Impl(Sink sink) : log_(std::move(sink)) {}

  absl::Status Take(std::string_view piece) {
    if (known_) return Pass(piece);
    // The first bytes tell whether it is packed, and may arrive one by one.
    begin_.append(piece);
    if (begin_.size() < kZstdMagic.size() && kZstdMagic.starts_with(begin_)) {
      return absl::OkStatus();
    }
    return PassBegin();
  }
  absl::Status End() {
    if (!known_) {
      RETURN_IF_ERROR(PassBegin());
    }
    return unpacker_ ? unpacker_->End() : absl::OkStatus();
  }

 private:
  absl::Status PassBegin() {
    known_ = true;
    if (begin_.starts_with(kZstdMagic)) unpacker_.emplace(log_);
    const std::string begin = std::move(begin_);
    return Pass(begin);
  }
  absl::Status Pass(std::string_view piece) {
    if (piece.empty()) return absl::OkStatus();
    return unpacker_ ? unpacker_->Take(piece) : log_.Take(piece);
  }

  Bounded log_;
  std::optional<Unpacker> unpacker_;
  std::string begin_;
  bool known_ = false;  // whether it is packed
};

LogUnpacker::LogUnpacker(Sink sink) : impl_(std::make_unique<Impl>(std::move(sink))) {}
LogUnpacker::~LogUnpacker() = default;

absl::Status LogUnpacker::Take(std::string_view piece) { return impl_->Take(piece); }

absl::Status LogUnpacker::End() { return impl_->End(); }

namespace {

// `next` returns the next piece, "" at the end.
absl::StatusOr<std::string> Collect(
    const std::function<absl::StatusOr<std::string_view>()>& next) {
  std::string log;
  LogUnpacker unpacker([&](std::string_view piece) {
    log.append(piece);
    return absl::OkStatus();
  });
  for (;;) {
    ASSIGN_OR_RETURN(std::string_view piece, next());
    if (piece.empty()) break;
    RETURN_IF_ERROR(unpacker.Take(piece));
  }
  RETURN_IF_ERROR(unpacker.End());
  return log;
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
