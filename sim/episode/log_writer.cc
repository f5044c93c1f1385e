#include "sim/episode/log_writer.h"

#include <poll.h>
#include <unistd.h>
#include <zstd.h>

#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

namespace myograde::sim {
namespace {

// Packed at once: large enough for zstd, small enough that the pipe takes it soon.
constexpr size_t kBlockBytes = 128 << 10;
// Kept free for the last event of a log.
constexpr int64_t kEndBytes = 4 << 10;
// The fastest level: a log must cost next to nothing, and actions hardly shrink further.
constexpr int kLevel = 1;
constexpr int kPipeTimeoutMs = 60'000;

}  // namespace

struct LogWriter::Packer {
  Packer() : context(ZSTD_createCCtx()) {
    ZSTD_CCtx_setParameter(context, ZSTD_c_compressionLevel, kLevel);
  }
  ~Packer() { ZSTD_freeCCtx(context); }
  Packer(const Packer&) = delete;
  Packer& operator=(const Packer&) = delete;

  ZSTD_CCtx* context;
  std::vector<char> out;
};

LogWriter::LogWriter(int fd, int64_t budget, double period)
    : fd_(fd), budget_(budget), encoder_(period), packer_(std::make_unique<Packer>()) {}
LogWriter::~LogWriter() = default;

void LogWriter::Begin(const LogHeader& header) {
  ZSTD_CCtx_reset(packer_->context, ZSTD_reset_session_only);
  waiting_.clear();
  waiting_steps_ = 0;
  info_ = {};
  full_ = false;
  started_ = false;
  encoder_.Header(header, waiting_);
}

void LogWriter::Start(const LogStart& start) {
  started_ = true;
  encoder_.Start(start, waiting_);
}

void LogWriter::Step(std::span<const double> action, const ShortDigest& observation,
                     const ShortDigest& state) {
  if (full_) return;
  encoder_.Step(action, observation, state, waiting_);
  ++waiting_steps_;
  if (waiting_.size() >= kBlockBytes) Flush();
}

// Packs what waits if it surely fits, whatever zstd makes of it; else drops it.
void LogWriter::Flush() {
  const auto most = static_cast<int64_t>(ZSTD_compressBound(waiting_.size()));
  if (info_.packed_bytes + most + kEndBytes > budget_ && waiting_steps_ > 0) {
    full_ = true;
    waiting_.clear();
    waiting_steps_ = 0;
    return;
  }
  info_.steps += std::exchange(waiting_steps_, 0);
  Pack(/*last=*/false);
}

absl::StatusOr<EpisodeLogInfo> LogWriter::End(LogEnd end) {
  Flush();
  end.logged = info_.steps;
  // Steps that were dropped leave no gap in the numbers of the events.
  encoder_.Resume(/*number=*/(started_ ? 2 : 1) + 2 * end.logged, end.logged);
  encoder_.End(end, ToHex(digest_.Peek()), waiting_);
  Pack(/*last=*/true);
  info_.sha256 = digest_.FinishHex();
  if (!status_.ok()) return status_;
  return info_;
}

void LogWriter::Pack(bool last) {
  digest_.Update(waiting_);
  info_.bytes += static_cast<int64_t>(waiting_.size());
  packer_->out.resize(ZSTD_compressBound(waiting_.size()) + 64);
  ZSTD_inBuffer in = {waiting_.data(), waiting_.size(), 0};
  size_t left = 0;
  do {
    ZSTD_outBuffer out = {packer_->out.data(), packer_->out.size(), 0};
    left = ZSTD_compressStream2(packer_->context, &out, &in, last ? ZSTD_e_end : ZSTD_e_flush);
    if (ZSTD_isError(left)) {
      status_ = absl::InternalError(
          absl::StrCat("can't compress the episode's log: ", ZSTD_getErrorName(left)));
      break;
    }
    info_.packed_bytes += static_cast<int64_t>(out.pos);
    if (status_.ok()) status_ = Send({packer_->out.data(), out.pos});
  } while (left != 0 || in.pos < in.size);
  waiting_.clear();
}

absl::Status LogWriter::Send(std::span<const char> bytes) {
  while (!bytes.empty()) {
    const ssize_t n = write(fd_, bytes.data(), bytes.size());
    if (n > 0) {
      bytes = bytes.subspan(static_cast<size_t>(n));
      continue;
    }
    if (errno == EINTR) continue;
    if (errno != EAGAIN) {
      return absl::UnavailableError(
          absl::StrCat("the runner does not accept the episode's log: ", std::strerror(errno)));
    }
    pollfd entry = {fd_, POLLOUT, 0};
    if (poll(&entry, 1, kPipeTimeoutMs) == 0) {
      return absl::DeadlineExceededError(
          "the runner did not accept the episode's log within a minute");
    }
  }
  return absl::OkStatus();
}

}  // namespace myograde::sim
