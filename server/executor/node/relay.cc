#include "server/executor/node/relay.h"

#include <sys/eventfd.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

// Records that arrive together go together: each write waits for the disk.
constexpr absl::Duration kGather = absl::Milliseconds(200);
constexpr size_t kMostAtOnce = 1u << 20;

}  // namespace

Relay::Relay(LeaseChannel& channel, const RelayLimits& limits)
    : channel_(channel),
      limits_(limits),
      wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      last_(SystemClock().Monotonic()),
      delay_(absl::ZeroDuration()),
      thread_([this] { Run(); }) {}

Relay::~Relay() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  news_.NotifyAll();
  thread_.join();
}

void Relay::AddLog(std::string name, Fd file) {
  const MutexLock lock(mutex_);
  if (!cut_off_) items_.push_back({std::move(name), std::move(file), {}});
}

void Relay::AddRecords(std::string_view lines) {
  {
    const MutexLock lock(mutex_);
    if (cut_off_) return;
    const bool joins = !items_.empty() && items_.back().log.empty() &&
                       items_.back().records.size() + lines.size() <= kMostAtOnce;
    if (!joins) items_.emplace_back();
    items_.back().records += lines;
    kept_ += lines.size();
    if (kept_ <= limits_.most_kept || !status_.ok()) {
      news_.NotifyAll();
      return;
    }
    status_ = absl::ResourceExhaustedError(absl::StrCat(
        "the way back to the daemon is too slow: ", kept_, " bytes of records wait to be sent"));
  }
  Wake();
}

absl::Status Relay::status() const {
  const MutexLock lock(mutex_);
  return status_;
}

bool Relay::over() const {
  const MutexLock lock(mutex_);
  return over_;
}

void Relay::AddEnd(const NodeEnd& end) {
  const MutexLock lock(mutex_);
  end_ = end;
  news_.NotifyAll();
}

void Relay::EndNow(const NodeEnd& end) {
  const MutexLock lock(mutex_);
  end_ = end;
  cut_off_ = true;
  items_.clear();
  kept_ = 0;
  delay_ = absl::ZeroDuration();
  news_.NotifyAll();
}

void Relay::Wake() const { eventfd_write(wake_.get(), 1); }

absl::Duration Relay::NextLook() const {
  if (delay_ > absl::ZeroDuration()) return last_ + delay_;
  if (end_.has_value()) return last_;
  // After an error nothing but the end is sent.
  if (!status_.ok()) return absl::InfiniteDuration();
  return last_ + (items_.empty() ? limits_.beat : std::min(kGather, limits_.beat));
}

bool Relay::Await() {
  const MutexLock lock(mutex_);
  while (!stop_ && !over_) {
    const absl::Duration left = NextLook() - SystemClock().Monotonic();
    if (left <= absl::ZeroDuration()) return true;
    const absl::Duration wait = std::min(left, absl::Hours(1));
    news_.WaitUntil(mutex_, std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(wait));
  }
  return false;
}

void Relay::TakePending() {
  const MutexLock lock(mutex_);
  if (cut_off_ || !status_.ok()) {
    pending_.reset();
    return;
  }
  if (pending_.has_value() || items_.empty()) return;
  pending_ = std::move(items_.front());
  items_.pop_front();
}

absl::Status Relay::SendPending() {
  if (!pending_.has_value()) return channel_.AddRecords(sent_, "");
  if (!pending_->log.empty()) {
    absl::Status status = channel_.PutLog(pending_->log, pending_->file.get());
    if (status.ok()) pending_.reset();
    return status;
  }
  const std::string& records = pending_->records;
  RETURN_IF_ERROR(channel_.AddRecords(sent_, records));
  hash_.Update(records);
  sent_ += static_cast<int64_t>(records.size());
  const MutexLock lock(mutex_);
  kept_ -= std::min(kept_, records.size());
  pending_.reset();
  return absl::OkStatus();
}

absl::Status Relay::SendEnd(NodeEnd end) {
  const Sha256Digest digest = hash_.Peek();
  end.records_bytes = sent_;
  end.records_sha256 = HexOf(digest);
  return channel_.PutEnd(end);
}

void Relay::Run() {
  while (Await()) {
    TakePending();
    std::optional<NodeEnd> end;
    {
      const MutexLock lock(mutex_);
      if (!pending_.has_value() && items_.empty()) end = end_;
    }
    const absl::Status status = end.has_value() ? SendEnd(*std::move(end)) : SendPending();
    Note(status, end.has_value());
  }
}

// What a use of the channel came to. `ending`: it was the end that was sent.
void Relay::Note(const absl::Status& status, bool ending) {
  const absl::Duration now = SystemClock().Monotonic();
  {
    const MutexLock lock(mutex_);
    last_ = now;
    if (status.ok()) {
      failing_since_.reset();
      delay_ = absl::ZeroDuration();
      over_ = ending;
      if (!ending) return;
    } else if (ChannelMayRecover(status)) {
      if (!failing_since_.has_value()) failing_since_ = now;
      delay_ = std::clamp(2 * delay_, limits_.first_delay, limits_.longest_delay);
      if (now - *failing_since_ < limits_.cut_after) return;
      if (status_.ok()) {
        status_ = absl::UnavailableError(absl::StrCat(
            "the way back to the daemon was cut for ", absl::FormatDuration(limits_.cut_after),
            ": ", status.message()));
      }
      over_ = end_.has_value();
    } else {
      // What is gone does not come back: the attempt is over.
      if (status_.ok()) {
        status_ = absl::IsNotFound(status) ? absl::CancelledError(status.message()) : status;
      }
      over_ = ending;
      delay_ = absl::ZeroDuration();
    }
  }
  Wake();
}

}  // namespace myograde::server
