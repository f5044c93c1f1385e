// The loop, the journal and the requests. Leases: engine_leases.cc; what is
// taken up from the store: engine_recover.cc.
#include "server/daemon/engine.h"

#include <poll.h>

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

namespace myograde::server {
namespace {

constexpr size_t kMaxCommands = 1024;
constexpr absl::Duration kRetry = absl::Seconds(1);
constexpr absl::Duration kLongestPoll = absl::Seconds(1);
constexpr absl::Duration kReapPoll = absl::Milliseconds(10);

// Trouble that may pass: the same change can succeed later.
bool MayPass(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsResourceExhausted(status) ||
         absl::IsPermissionDenied(status);
}

}  // namespace

Engine::Engine(EngineOptions options, Store& store, ReaderPool& readers, const Clock& clock)
    : options_(std::move(options)),
      store_(store),
      readers_(readers),
      clock_(clock),
      owner_(absl::StrCat("daemon ", getpid())),
      commands_(kMaxCommands),
      scheduler_(options_.config.scheduler) {}

Engine::~Engine() = default;

void Engine::Stop() {
  stop_ = true;
  commands_.Wake();
}

absl::Status Engine::Run() {
  absl::Status status;
  while (!stop_ && status.ok()) status = Iterate();
  commands_.Close();
  status.Update(Shutdown());
  return status;
}

absl::Status Engine::Iterate() {
  commands_.RunAll();
  for (auto& [id, run] : running_) Listen(run);
  CheckDeadlines();
  Reap();
  if (absl::Status status = Flush(); !status.ok()) return status;
  if (journal_.empty()) {
    if (absl::Status status = SettleAll(); !status.ok()) return status;
    if (!stop_) StartLeases();
    if (absl::Status status = Flush(); !status.ok()) return status;
  }
  absl::Duration timeout = kLongestPoll;
  for (const auto& [id, run] : running_) {
    // Both streams are at their end: only the process itself is waited for.
    if (run.runner->stdout_fd() < 0 && run.runner->stderr_fd() < 0) timeout = kReapPoll;
  }
  const absl::Duration now = clock_.Monotonic();
  {
    const std::lock_guard lock(mutex_);
    if (const auto next = scheduler_.NextDeadline(now)) timeout = std::min(timeout, *next - now);
  }
  Poll(std::max(timeout, absl::ZeroDuration()));
  return absl::OkStatus();
}

void Engine::Poll(absl::Duration timeout) {
  std::vector<pollfd> fds = {{commands_.wake_fd(), POLLIN, 0}};
  for (const auto& [id, run] : running_) {
    for (const int fd : {run.runner->stdout_fd(), run.runner->stderr_fd()}) {
      if (fd >= 0) fds.push_back({fd, POLLIN, 0});
    }
  }
  // Rounded up: a deadline that is 0.3 ms away must not spin.
  const int ms = static_cast<int>(
      absl::ToInt64Milliseconds(absl::Ceil(timeout, absl::Milliseconds(1))));
  poll(fds.data(), fds.size(), ms);
}

absl::Status Engine::Flush() {
  if (journal_.empty() || clock_.Monotonic() < flush_after_) return absl::OkStatus();
  while (!journal_.empty()) {
    const absl::Status status = store_.Write(journal_.front());
    if (!status.ok() && !MayPass(status)) {
      return absl::Status(status.code(), absl::StrCat("a change of state can't be written: ",
                                                      status.message()));
    }
    const std::lock_guard lock(mutex_);
    if (!status.ok()) {
      if (store_trouble_ != status.message()) spdlog::error("{}", std::string(status.message()));
      store_trouble_ = std::string(status.message());
      flush_after_ = clock_.Monotonic() + kRetry;
      return absl::OkStatus();
    }
    store_trouble_.clear();
    journal_.pop_front();
  }
  return absl::OkStatus();
}

absl::Status Engine::SettleAll() {
  while (!to_settle_.empty()) {
    const int64_t evaluation = *to_settle_.begin();
    const absl::Status status = Settle(evaluation);
    if (!status.ok()) {
      if (!MayPass(status)) return status;
      spdlog::error("evaluation {}: {}", evaluation, std::string(status.message()));
      return absl::OkStatus();  // it stays in the set, for the next round
    }
    to_settle_.erase(evaluation);
    contexts_.erase(evaluation);
  }
  return absl::OkStatus();
}

absl::StatusOr<bool> Engine::AddArtefact(const ArtefactRow& artefact, absl::Duration timeout) {
  const auto is_new = std::make_shared<bool>(false);
  const absl::Status status = commands_.Call(
      [this, artefact, is_new] {
        return store_.Write([&](Writer& writer) -> absl::Status {
          absl::StatusOr<bool> added = writer.AddArtefact(artefact);
          if (added.ok()) *is_new = *added;
          return added.status();
        });
      },
      timeout);
  if (!status.ok()) return status;
  return *is_new;
}

absl::StatusOr<Accepted> Engine::Admit(
    const std::function<absl::StatusOr<Accepted>(Writer&)>& add) {
  absl::Status status = Flush();
  if (!status.ok()) return status;
  if (!journal_.empty()) {
    const std::lock_guard lock(mutex_);
    return absl::UnavailableError(absl::StrCat("the store can't be written: ", store_trouble_));
  }
  Accepted accepted;
  status = store_.Write([&](Writer& writer) -> absl::Status {
    absl::StatusOr<Accepted> added = add(writer);
    if (added.ok()) accepted = *added;
    return added.status();
  });
  if (status.ok()) status = AddEvaluation(accepted.evaluation);
  if (!status.ok()) return status;
  return accepted;
}

absl::StatusOr<Accepted> Engine::Submit(const NewSubmission& submission, const std::string& who,
                                        absl::Duration timeout) {
  const auto accepted = std::make_shared<Accepted>();
  const absl::Status status = commands_.Call(
      [this, submission, who, accepted]() -> absl::Status {
        absl::StatusOr<Accepted> added =
            Admit([&](Writer& writer) { return writer.Accept(submission, who); });
        if (added.ok()) *accepted = *std::move(added);
        return added.status();
      },
      timeout);
  if (!status.ok()) return status;
  return *accepted;
}

absl::StatusOr<Accepted> Engine::Rerun(const NewRerun& rerun, const std::string& who,
                                       absl::Duration timeout) {
  const auto accepted = std::make_shared<Accepted>();
  const absl::Status status = commands_.Call(
      [this, rerun, who, accepted]() -> absl::Status {
        absl::StatusOr<Accepted> added =
            Admit([&](Writer& writer) { return writer.AddRerun(rerun, who); });
        if (added.ok()) *accepted = *std::move(added);
        return added.status();
      },
      timeout);
  if (!status.ok()) return status;
  return *accepted;
}

absl::Status Engine::Cancel(int64_t submission, const std::string& why, const std::string& who,
                            absl::Duration timeout) {
  return commands_.Call(
      [this, submission, why, who] { return RunCancel(submission, why, who); }, timeout);
}

absl::Status Engine::RunCancel(int64_t submission, const std::string& why,
                               const std::string& who) {
  // What is in the journal comes first: episodes that ended before the cancel stay.
  flush_after_ = absl::ZeroDuration();
  if (absl::Status status = Flush(); !status.ok()) return status;
  if (!journal_.empty()) {
    return absl::UnavailableError("the store can't be written; nothing was cancelled");
  }
  // An evaluation whose leases have all ended is about to get its result.
  if (absl::Status status = SettleAll(); !status.ok()) return status;
  std::vector<std::shared_ptr<const Context>> open;
  for (const auto& [id, context] : contexts_) {
    if (context->submission == submission) open.push_back(context);
  }
  if (open.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("submission ", submission, " has ended; there is nothing to cancel"));
  }
  const absl::Status status = store_.Write([&](Writer& writer) {
    absl::Status written;
    for (const auto& context : open) {
      for (const auto& [lease, episodes] : context->leases) {
        const absl::Status ended =
            writer.EndLease(lease, LeaseState::kCancelled, /*fault=*/false, who, why);
        // Refused: the lease was done before.
        if (!absl::IsFailedPrecondition(ended)) written.Update(ended);
      }
      written.Update(
          writer.EndEvaluation(context->evaluation, EvaluationState::kCancelled, why, "", who));
    }
    return written;
  });
  if (!status.ok()) return status;
  std::vector<int64_t> to_kill;
  for (const auto& context : open) {
    const std::lock_guard lock(mutex_);
    const Verdict verdict = scheduler_.Cancel(context->evaluation);
    to_kill.insert(to_kill.end(), verdict.running.begin(), verdict.running.end());
  }
  KillLeases(to_kill);
  for (const auto& context : open) contexts_.erase(context->evaluation);
  return absl::OkStatus();
}

std::optional<QueuePlace> Engine::PlaceOf(int64_t evaluation) const {
  const std::lock_guard lock(mutex_);
  return scheduler_.PlaceOf(evaluation);
}

std::string Engine::WhyWaiting(int64_t evaluation) const {
  const std::lock_guard lock(mutex_);
  const std::string why = scheduler_.WhyWaiting(evaluation, clock_.Monotonic());
  if (why.empty() || store_trouble_.empty()) return why;
  return absl::StrCat(why, "; no lease starts while the store can't be written: ", store_trouble_);
}

std::map<int64_t, LiveLease> Engine::Running() const {
  const std::lock_guard lock(mutex_);
  std::map<int64_t, LiveLease> leases;
  for (const auto& [id, live] : live_) {
    leases[id] = {live.episode, live.step, clock_.Monotonic() - live.since};
  }
  return leases;
}

LiveHealth Engine::Health() const {
  const std::lock_guard lock(mutex_);
  return {scheduler_.running(), scheduler_.pending(), store_trouble_};
}

}  // namespace myograde::server
