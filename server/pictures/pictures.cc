#include "server/pictures/pictures.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr std::chrono::seconds kIdleLook(5);
// A log that can't be shown stays so, as long as the daemon runs and remembers it.
constexpr absl::Duration kForGood = absl::Hours(24);
constexpr absl::Duration kAfterTrouble = absl::Minutes(1);
constexpr size_t kMostFailures = 10'000;

// What people call what is made, in the order of PictureKind.
constexpr std::array kKindNames = {"the trajectory of log", "the picture of log",
                                   "the model file of"};

}  // namespace

Pictures::Pictures(PicturesOptions options, const Clock& clock)
    : options_(std::move(options)),
      clock_(clock),
      files_(options_.folder, options_.build, options_.most_bytes),
      busy_at_(clock.Monotonic()),
      thread_([this] {
        files_.RemoveDrafts();
        while (const std::optional<Job> job = Next()) Make(*job);
      }) {}

Pictures::~Pictures() {
  Stop();
  thread_.join();
}

void Pictures::Stop() {
  {
    const MutexLock lock(mutex_);
    stop_ = true;
  }
  wake_.NotifyAll();
}

PictureState Pictures::Ask(const PictureKey& key, const std::string& who) {
  using Is = PictureState::Is;
  const MutexLock lock(mutex_);
  if (playing_ == key) {
    playing_was_asked_ = true;
    return {Is::kPlaying, 0, ""};
  }
  // Under the lock, as a file is kept before its job ends.
  if (files_.Has(key)) return {Is::kReady, 0, ""};
  const auto job = std::find_if(waiting_.begin(), waiting_.end(),
                                [&](const Job& one) { return one.key == key; });
  if (job != waiting_.end()) {
    return {Is::kWaiting, job - waiting_.begin() + (playing_.has_value() ? 1 : 0), ""};
  }
  const auto failure = failures_.find(key);
  if (failure != failures_.end()) {
    const std::string& why = failure->second.why;
    if (clock_.Monotonic() < failure->second.again) {
      return {why.empty() ? Is::kMissing : Is::kFailed, 0, why};
    }
    failures_.erase(failure);
  }
  const auto own = static_cast<size_t>(std::count_if(
      waiting_.begin(), waiting_.end(), [&](const Job& one) { return one.who == who; }));
  if (waiting_.size() >= kMostWaiting || (!who.empty() && own >= kMostOfOne)) {
    return {Is::kFull, 0, ""};
  }
  waiting_.push_back({key, who});
  wake_.NotifyAll();
  return {Is::kWaiting, std::ssize(waiting_) - 1 + (playing_.has_value() ? 1 : 0), ""};
}

std::optional<Pictures::Job> Pictures::Next() {
  while (true) {
    {
      const MutexLock lock(mutex_);
      if (stop_) return std::nullopt;
      if (!waiting_.empty()) {
        Job job = std::move(waiting_.front());
        waiting_.pop_front();
        playing_ = job.key;
        playing_was_asked_ = true;
        return job;
      }
    }
    if (const std::optional<Job> job = NextSuggested()) {
      Make(*job);
      continue;
    }
    const auto later = std::chrono::steady_clock::now() + kIdleLook;
    const MutexLock lock(mutex_);
    while (!stop_ && waiting_.empty() && wake_.WaitUntil(mutex_, later)) {
    }
  }
}

std::optional<Pictures::Job> Pictures::NextSuggested() {
  if (options_.grading()) {
    busy_at_ = clock_.Monotonic();
    return std::nullopt;
  }
  if (clock_.Monotonic() - busy_at_ < options_.quiet) return std::nullopt;
  if (suggested_.empty()) {
    for (PictureKey& key : options_.suggestions()) suggested_.push_back(std::move(key));
  }
  while (!suggested_.empty()) {
    const PictureKey key = std::move(suggested_.front());
    suggested_.pop_front();
    const MutexLock lock(mutex_);
    if (files_.Has(key) || failures_.contains(key)) continue;
    playing_ = key;
    playing_was_asked_ = false;
    return Job{key, ""};
  }
  return std::nullopt;
}

void Pictures::Make(const Job& job) {
  // One that nobody asked for makes room for what people wait for.
  const auto stopped = [this] {
    {
      const MutexLock lock(mutex_);
      if (stop_) return true;
      if (playing_was_asked_) return false;
      if (!waiting_.empty()) return true;
    }
    return options_.grading();
  };
  const auto make = [&]() -> absl::Status {
    try {
      ASSIGN_OR_RETURN(const std::string bytes, options_.make(job.key, stopped));
      return files_.Keep(job.key, bytes);
    } catch (const std::exception& error) {  // of no memory
      return absl::InternalError(error.what());
    }
  };
  const absl::Status status = make();
  const MutexLock lock(mutex_);
  if (absl::IsCancelled(status) && !stop_) {
    // It was for nobody when it was stopped, and may be for somebody now.
    if (playing_was_asked_) {
      waiting_.push_front({job.key, job.who});
    } else {
      suggested_.push_front(job.key);
    }
  } else if (!status.ok() && !stop_) {
    NoteFailure(job.key, status);
  }
  playing_.reset();
}

void Pictures::NoteFailure(const PictureKey& key, const absl::Status& why) {
  const std::string text(why.message());
  if (failures_.size() >= kMostFailures) failures_.erase(failures_.begin());
  Failure& failure = failures_[key];
  failure.again = clock_.Monotonic() + (absl::IsDataLoss(why) ? kForGood : kAfterTrouble);
  if (absl::IsNotFound(why)) {
    failure.why = "";
  } else if (absl::IsDataLoss(why)) {
    failure.why = text;
  } else {
    spdlog::warn("can't make {} {}: {}", kKindNames[static_cast<size_t>(key.kind)], key.of,
                 text);
    failure.why = "it could not be made, by a fault of this server; its log says why, for the organisers";
  }
}

}  // namespace myograde::server
