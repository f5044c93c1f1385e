// The loop turn, the journal, the requests, and what other threads see. Leases: engine_leases.cc; how
// they end: engine_ends.cc; recovery from the store: engine_recover.cc; the host's health:
// engine_host.cc.
#include "server/engine/engine_core.h"

#include <unistd.h>

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kRetry = absl::Seconds(1);
constexpr absl::Duration kLongestWait = absl::Seconds(1);
constexpr absl::Duration kReapWait = absl::Milliseconds(10);
constexpr absl::Duration kStayWait = absl::Milliseconds(500);
// So many leases in a row are no accident of single nodes any more.
constexpr int kManyLosses = 10;

}  // namespace

EngineCore::EngineCore(EngineOptions options, StoreWriter& disk, ReaderPool& readers,
                       Executor& executor, const Clock& clock)
    : options_(std::move(options)),
      disk_(disk),
      readers_(readers),
      executor_(executor),
      clock_(clock),
      owner_(absl::StrCat("daemon ", getpid())),
      scheduler_(options_.config.scheduler),
      host_(options_.config.host) {}

absl::StatusOr<absl::Duration> EngineCore::RunOnce() {
  WatchStore();
  WriteRequests();
  AttendExecutor();
  // Silence is judged at this time: what a runner wrote until now is read, however long the daemon
  // itself stands still after its look.
  const absl::Duration listened = clock_.Monotonic();
  for (auto& [id, run] : running_) Listen(run);
  ReapRunners();
  ReclaimOverdue(listened);
  ReapStopping();
  ReopenSlots();
  AnswerCancels();
  PollSelfTest();
  Escalate();
  RETURN_IF_ERROR(Flush());
  if (journal_.empty()) {
    if (clock_.Monotonic() >= next_disk_look_) LookAtDisk();
    RETURN_IF_ERROR(EnqueueDeferred());
    RETURN_IF_ERROR(SettleAll());
    if (!stopping_) StartLeases();
    RETURN_IF_ERROR(Flush());
  }
  return TimeToNext(clock_.Monotonic());
}

absl::Duration EngineCore::TimeToNext(absl::Duration now) const {
  absl::Duration wait = kLongestWait;
  for (const auto& [id, run] : running_) {
    if (run.runner->pid() == 0) break;  // no process of this host's
    // Both streams have ended: only the process itself is left to wait for.
    if (run.runner->stdout_fd() < 0 && run.runner->stderr_fd() < 0) wait = kReapWait;
  }
  for (const StoppingRunner& ending : stopping_runners_) {
    const bool polled = ending.stays || ending.runner->pid() == 0;
    wait = std::min(wait, polled ? kStayWait : kReapWait);
  }
  if (!cancels_.empty()) wait = kReapWait;
  if (test_.has_value()) {
    const bool quiet = test_->runner == nullptr || test_->runner->stdout_fd() < 0;
    wait = quiet ? kReapWait : std::min(wait, test_->deadline - now);
  }
  const MutexLock lock(mutex_);
  if (!troubles_.closed_slots.empty()) wait = std::min(wait, next_slot_check_ - now);
  if (const auto next = scheduler_.NextDeadline(now)) wait = std::min(wait, *next - now);
  return std::max(wait, absl::ZeroDuration());
}

void EngineCore::AddDescriptors(std::vector<pollfd>& fds) const {
  const auto add = [&fds](const Runner& runner) {
    for (const int fd : {runner.stdout_fd(), runner.stderr_fd()}) {
      if (fd >= 0) fds.push_back({fd, POLLIN, 0});
    }
  };
  for (const auto& [id, run] : running_) add(*run.runner);
  if (test_.has_value() && test_->runner != nullptr) add(*test_->runner);
}

// After a failure that may pass, no write is tried for a second: each may take as long as the store
// waits for a lock, and the loop waits with it.
absl::Status EngineCore::WriteNow(const StoreChange& change) {
  const absl::Duration now = clock_.Monotonic();
  absl::Status status;
  if (now >= write_after_) {
    status = disk_.Write(change);
    if (!MayPass(status)) {
      const MutexLock lock(mutex_);
      if (!troubles_.store_trouble.empty()) spdlog::info("the store is writable again");
      troubles_.store_trouble.clear();
      return status;
    }
    write_after_ = clock_.Monotonic() + kRetry;
    const MutexLock lock(mutex_);
    const std::string trouble(status.message());
    if (troubles_.store_trouble != trouble) spdlog::error("{}", trouble);
    troubles_.store_trouble = trouble;
  }
  const MutexLock lock(mutex_);
  return absl::UnavailableError(
      absl::StrCat("can't write the store; nothing was changed: ", troubles_.store_trouble));
}

// In one transaction, so that there is a single wait for the disk.
absl::Status EngineCore::Flush() {
  if (journal_.empty()) return absl::OkStatus();
  absl::Status status = WriteNow([this](Transaction& writer) { return WriteJournal(writer); });
  if (status.ok()) ClearJournal();
  if (status.ok() || MayPass(status)) return absl::OkStatus();
  // One entry was rejected: its evaluation ends for that, and all the others must stand.
  while (!journal_.empty()) {
    const Entry entry = journal_.front();
    status = WriteNow(entry.change);
    if (MayPass(status)) return absl::OkStatus();
    if (IsBrokenStore(status)) return status;
    journal_.pop_front();
    journal_size_ = std::ssize(journal_);
    if (!status.ok()) GiveUpUnreadable(entry.evaluation, std::string(status.message()));
  }
  return absl::OkStatus();
}

void EngineCore::ClearJournal() {
  journal_.clear();
  journal_size_ = 0;
}

absl::Status EngineCore::WriteJournal(Transaction& writer) const {
  for (const Entry& entry : journal_) {
    RETURN_IF_ERROR(entry.change(writer));
  }
  return absl::OkStatus();
}

// The journal happened before this request, so it is written first.
absl::Status EngineCore::RequireWritable() {
  RETURN_IF_ERROR(Flush());
  if (journal_.empty()) return absl::OkStatus();
  const MutexLock lock(mutex_);
  return absl::UnavailableError(
      absl::StrCat("can't write the store; nothing was changed: ", troubles_.store_trouble));
}

// A store that lost its file takes writes without an error, and a corrupt one most of them: look
// before anybody is told that something was written. And nothing may need writing while a trouble
// ends.
void EngineCore::WatchStore() {
  const absl::Duration now = clock_.Monotonic();
  bool troubled = false;
  {
    const MutexLock lock(mutex_);
    troubled = !troubles_.store_trouble.empty();
  }
  if (troubled ? !journal_.empty() || now < write_after_ : now < next_store_check_) return;
  next_store_check_ = now + kRetry;
  if (!troubled && disk_.Check().ok()) return;
  (void)WriteNow([](Transaction&) { return absl::OkStatus(); });
}

absl::Status EngineCore::SettleAll() {
  while (!to_settle_.empty()) {
    const int64_t evaluation = *to_settle_.begin();
    const absl::Status status = Settle(evaluation);
    if (MayPass(status)) return absl::OkStatus();  // stays deferred until the next round
    if (IsBrokenStore(status)) return status;
    if (!status.ok()) GiveUpUnreadable(evaluation, std::string(status.message()));
    to_settle_.erase(evaluation);
    contexts_.erase(evaluation);
  }
  return absl::OkStatus();
}

void EngineCore::Escalate() {
  std::vector<int64_t> late;
  {
    const MutexLock lock(mutex_);
    late = scheduler_.Escalate(clock_.Monotonic());
  }
  const std::string waited =
      absl::FormatDuration(options_.config.scheduler.queue_wait);
  for (const int64_t id : late) {
    const LogScope scope({.evaluation = id});
    spdlog::warn("evaluation {} has waited for {} and now goes first", id, waited);
    AddToJournal(id, [id, waited, who = owner_](Transaction& writer) {
      return writer.evaluations.Note(
          id, who, absl::StrCat("waited for ", waited, " and now goes first"));
    });
  }
}

void EngineCore::TellLater(const std::string& event, const nlohmann::json& about) {
  AddToJournal(0, [event, about](Transaction& writer) {
    const absl::Status told =
        writer.Part([&](Transaction& part) { return part.deliveries.Tell(event, about); });
    if (!told.ok()) spdlog::error("{} could not be notified: {}", event, std::string(told.message()));
    return absl::OkStatus();
  });
}

void EngineCore::WriteRequests() {
  if (requests_.empty()) return;
  const std::vector<Request> requests = std::exchange(requests_, {});
  std::vector<absl::Status> statuses(
      requests.size(),
      absl::CancelledError("the daemon is stopping; try again when it is back"));
  if (!stopping_) WriteTogether(requests, statuses);
  for (size_t i = 0; i < requests.size(); ++i) {
    if (statuses[i].ok() && requests[i].effect) statuses[i] = requests[i].effect();
    requests[i].answer(statuses[i]);
  }
}

// The journal happened before and goes first. One transaction, so that there is a single wait for
// the disk.
void EngineCore::WriteTogether(const std::vector<Request>& requests,
                               std::vector<absl::Status>& statuses) {
  const absl::Status all = WriteNow([&](Transaction& writer) {
    absl::Status status = WriteJournal(writer);
    for (size_t i = 0; i < requests.size() && status.ok(); ++i) {
      statuses[i] = writer.Part(requests[i].change);
    }
    return status;
  });
  if (all.ok()) return ClearJournal();
  statuses.assign(requests.size(), all);
  if (MayPass(all)) return;
  // One request's fault must not harm the others.
  const absl::Status ready = RequireWritable();
  for (size_t i = 0; i < requests.size(); ++i) {
    statuses[i] = ready.ok() ? WriteNow(requests[i].change) : ready;
  }
}

void EngineCore::BeginShutdown() {
  stopping_ = true;
  for (StoppingRunner& ending : stopping_runners_) {
    if (!ending.stays) continue;
    ending.stays = false;
    ending.kill_at = clock_.Monotonic() + Runner::kCleanUpGrace;
    ending.runner->AskToEnd();
  }
  while (!running_.empty()) {
    const auto& [lease, run] = *running_.begin();
    WriteReturn(run, /*fault=*/false, "the daemon stopped");
    metrics().CountReturn("stop");
    ReclaimAs(lease, RunEnd::kReturned);
  }
  if (test_.has_value()) EndSelfTest("the daemon stopped");
  write_after_ = absl::ZeroDuration();
}

absl::Status EngineCore::FinishShutdown() {
  stopping_ = true;
  WriteRequests();  // answers them
  for (StoppingRunner& ending : stopping_runners_) {
    ending.runner->KillNow();
    executor_.CleanUp(ending.work_dir);
  }
  stopping_runners_.clear();
  AnswerCancels();
  write_after_ = absl::ZeroDuration();
  return Flush();
}

QueueOutlook EngineCore::EstimateOutlook(int64_t evaluation) const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  QueueOutlook outlook;
  const std::optional<absl::Duration> deadline = scheduler_.DeadlineOf(evaluation);
  if (!deadline.has_value()) return outlook;
  if (*deadline != absl::InfiniteDuration()) {
    outlook.deadline = std::max(*deadline - now, absl::ZeroDuration());
  }
  outlook.place = scheduler_.PlaceOf(evaluation);
  outlook.waiting = scheduler_.WhyWaiting(evaluation, now);
  outlook.owner = owner_;
  if (!outlook.waiting.empty()) {
    const auto add = [&](const char* what, const std::string& why) {
      if (!why.empty()) absl::StrAppend(&outlook.waiting, "; nothing starts", what, ": ", why);
    };
    add("", host_.PauseReason(now));
    for (const auto& [slot, why] : troubles_.closed_slots) {
      absl::StrAppend(&outlook.waiting, "; slot ", slot, " is closed until ", why, " is gone");
    }
    add("", troubles_.executor_trouble);
    add("", troubles_.disk_trouble);
    add(" while the store can't be written", troubles_.store_trouble);
  }
  if (outlook.place.has_value() && mean_lease_ > absl::ZeroDuration() && host_.may_start()) {
    const auto ahead = static_cast<double>(outlook.place->blocks_ahead + scheduler_.running());
    const auto own = static_cast<double>(scheduler_.CountWaitingBlocks(evaluation));
    outlook.end = mean_lease_ * std::max((ahead + own) / options_.config.scheduler.slots, 1.0);
  }
  return outlook;
}

std::vector<int64_t> EngineCore::QueueOf(const std::set<std::string>* teams) const {
  const MutexLock lock(mutex_);
  return scheduler_.QueueOf(teams);
}

std::map<int64_t, LiveLease> EngineCore::Running(const std::set<int64_t>* among) const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  std::map<int64_t, LiveLease> leases;
  const auto add = [&](int64_t id, const Live& live) {
    LiveLease& shown = leases.emplace_hint(leases.end(), id, live.lease)->second;
    shown.running = now - live.since;
    shown.silent = now - live.heard;
  };
  if (among == nullptr) {
    for (const auto& [id, live] : live_) add(id, live);
    return leases;
  }
  for (const int64_t id : *among) {
    if (const auto live = live_.find(id); live != live_.end()) add(id, live->second);
  }
  return leases;
}

LiveHealth EngineCore::Health() const {
  const MutexLock lock(mutex_);
  const absl::Duration now = clock_.Monotonic();
  LiveHealth health;
  static_cast<EngineTroubles&>(health) = troubles_;
  health.running = scheduler_.running();
  health.pending = scheduler_.pending();
  if (lost_in_a_row_ >= kManyLosses) {
    health.losses = absl::StrCat("the last ", lost_in_a_row_, " leases were lost, the latest because: ",
                                 last_loss_);
  }
  health.host = host_.state();
  health.host_trouble = host_.PauseReason(now);
  health.journal = journal_size_;
  health.busy_slots = scheduler_.taken_slots() - static_cast<int>(troubles_.closed_slots.size());
  health.queue = scheduler_.DepthAt(now);
  for (const auto& [id, live] : live_) {
    const absl::Duration age = now - live.since;
    health.oldest_run = std::max(health.oldest_run.value_or(age), age);
  }
  if (health.host == HostHealth::State::kPaused) health.paused_for = now - host_.paused_since();
  if (const auto next = host_.NextTest()) {
    health.next_test = std::max(*next - now, absl::ZeroDuration());
  }
  return health;
}

}  // namespace myograde::server
