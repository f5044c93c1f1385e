// The executor's threads that write and read the spool.
#include <algorithm>
#include <chrono>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/status_macros.h"
#include "server/executor/slurm/slurm_executor.h"

namespace myograde::server {
namespace {

// Between two looks at whether the spool can be written, and two attempts at opening it.
constexpr absl::Duration kProbeEvery = absl::Seconds(10);
constexpr absl::Duration kOpenEvery = absl::Seconds(5);
// Between two looks at an attempt that a node plays, and at one that none has taken yet.
constexpr absl::Duration kPlayedEvery = absl::Milliseconds(200);
constexpr absl::Duration kWaitingEvery = absl::Seconds(1);

auto Until(absl::Duration time) {
  return std::chrono::steady_clock::now() + absl::ToChronoMilliseconds(time);
}

}  // namespace

// --- writing ---

void SlurmExecutor::WriteSpool() {
  absl::Duration next_probe = -absl::InfiniteDuration();
  while (true) {
    if (!spool_.has_value()) Note(OpenToWrite());
    while (const std::optional<Task> task = spool_.has_value() ? TakeTask() : std::nullopt) {
      Do(*task);
    }
    if (spool_.has_value() && Now() >= next_probe) {
      LookAfterSpool();
      next_probe = Now() + kProbeEvery;
    }
    const MutexLock lock(mutex_);
    writing_.since = absl::InfiniteDuration();
    if (!stopping_ && (!HasTask() || !spool_.has_value())) {
      write_.WaitUntil(mutex_, Until(spool_trouble_.empty() ? kProbeEvery : kOpenEvery));
    }
    if (stopping_) break;
    writing_.since = Now();
  }
  if (spool_.has_value()) spool_->RemoveLeases().IgnoreError();
}

// Makes the spool, and empties it of what an earlier daemon left.
absl::Status SlurmExecutor::OpenToWrite() {
  ASSIGN_OR_RETURN(Spool spool, Spool::Make(spool_path_));
  if (!hold_.valid()) {
    absl::StatusOr<Fd> hold = spool.Hold();
    if (absl::IsAlreadyExists(hold.status())) {
      return absl::UnavailableError(absl::StrCat(
          spool_path_, ": another daemon grades from this folder; stop it, or if its data folder is a "
          "copy of this one, make that one its own with \"myograde serve --adopt\""));
    }
    if (!hold.ok()) return hold.status();
    hold_ = *std::move(hold);
  }
  RETURN_IF_ERROR(spool.PutEpoch(epoch_));
  RETURN_IF_ERROR(spool.RemoveLeases());
  ASSIGN_OR_RETURN(const std::vector<std::string> packed, spool.Artefacts());
  for (const std::string& digest : packed) {
    RETURN_IF_ERROR(spool.RemoveArtefact(digest));
  }
  writer_.Forget();
  spool_.emplace(std::move(spool));
  const MutexLock lock(mutex_);
  emptied_ = true;
  next_look_ = Now();  // for jobs of an earlier daemon
  read_.NotifyAll();
  talk_.NotifyAll();
  return absl::OkStatus();
}

bool SlurmExecutor::HasTask() const {
  return !urgent_.empty() || (!tasks_.empty() && Now() >= next_write_);
}

std::optional<SlurmExecutor::Task> SlurmExecutor::TakeTask() {
  const MutexLock lock(mutex_);
  if (stopping_ || !HasTask()) return std::nullopt;
  writing_.since = Now();
  std::deque<Task>& queue = urgent_.empty() ? tasks_ : urgent_;
  Task task = std::move(queue.front());
  queue.pop_front();
  return task;
}

void SlurmExecutor::Do(const Task& task) {
  if (task.kind == Task::Kind::kWrite) return WriteOrder(task.name);
  absl::Status done;
  if (task.kind == Task::Kind::kRemove) {
    done = spool_->RemoveLease(task.name);
  } else if (const absl::StatusOr<LeaseFolder> folder = spool_->OpenLease(task.name); folder.ok()) {
    done = folder->Stop();
  }
  // What goes on in it is cancelled too, and counts for nothing.
  if (!done.ok()) spdlog::warn("{}", std::string(done.message()));
}

void SlurmExecutor::WriteOrder(const std::string& name) {
  std::shared_ptr<Attempt> attempt;
  NodeOrder order;
  {
    const MutexLock lock(mutex_);
    const auto it = attempts_.find(name);
    if (it == attempts_.end() || it->second->released) return;
    attempt = it->second;
    order = attempt->order;
  }
  absl::Status written =
      writer_.Write(*spool_, order, attempt->artefact, attempt->artefact_dir, Now());
  std::string token;
  if (written.ok() && door_ != nullptr) {
    absl::StatusOr<std::string> opened = door_->Open(name, attempt->artefact);
    written = opened.status();
    if (opened.ok()) token = *std::move(opened);
  }
  const bool passes = absl::IsResourceExhausted(written) || absl::IsUnavailable(written) ||
                      absl::IsNotFound(written);
  if (written.ok() || passes) Note(written);
  const MutexLock lock(mutex_);
  if (passes) {
    next_write_ = Now() + kOpenEvery;
    if (!attempt->released && !attempt->over) tasks_.push_front({Task::Kind::kWrite, name});
    return;
  }
  if (!written.ok()) {
    return Lose(*attempt, absl::StrCat("its order could not be written: ", written.message()));
  }
  attempt->token = std::move(token);
  attempt->grader = std::move(order.grader);
  attempt->view.ordered = Now();
  if (attempt->released) {
    if (door_ != nullptr) door_->Close(name);
    return;
  }
  jobs_.Add(name, attempt->evaluation, attempt->needs, Now());
  talk_.NotifyAll();
}

// Finds out whether the spool can still be written, and removes what nobody needs.
void SlurmExecutor::LookAfterSpool() {
  if (absl::Status status = spool_->Probe(); status.ok()) {
    Note(status);
  } else if (!absl::IsResourceExhausted(status) && door_ == nullptr) {
    OpenAgain();
  } else {
    Note(status);
  }
  std::set<std::string> used;
  {
    const MutexLock lock(mutex_);
    for (const auto& [name, attempt] : attempts_) {
      if (!attempt->released) used.insert(attempt->artefact);
    }
  }
  writer_.Prune(*spool_, used, Now());
}

// A folder that was mounted anew must be opened anew. It is never made again: on a mount point
// without its disk, no node would see it.
void SlurmExecutor::OpenAgain() {
  absl::StatusOr<Spool> again = Spool::Open(spool_path_);
  if (again.ok() && again->Epoch().value_or("") == epoch_) {
    spool_.emplace(*std::move(again));
    return Note(spool_->Probe());
  }
  Note(absl::UnavailableError(absl::StrCat(
      spool_path_, ": is gone, or another one is there; mount it again, or start the daemon again "
                   "if it was removed")));
}

void SlurmExecutor::Note(const absl::Status& status) {
  const MutexLock lock(mutex_);
  const std::string why = status.ok() ? "" : std::string(status.message());
  if (!why.empty() && why != spool_trouble_) spdlog::error("the spool: {}", why);
  if (why.empty() && !spool_trouble_.empty()) spdlog::info("the spool can be written again");
  if (spool_trouble_.empty()) spool_trouble_since_ = Now();
  spool_trouble_ = why;
}

// --- reading ---

void SlurmExecutor::ReadSpool() {
  std::optional<Spool> spool;
  std::map<std::string, LeaseReader> readers;
  const std::string logs = options_.data_dir + "/logs";
  while (true) {
    const bool open = OpenToRead(spool);
    const std::vector<std::string> names = ToRead(Now());
    for (const std::string& name : open ? names : std::vector<std::string>()) {
      const absl::Duration begun = Now();
      {
        const MutexLock lock(mutex_);
        if (stopping_) return;
        reading_.since = begun;
      }
      LeaseReader& reader = readers.try_emplace(name, name, logs).first->second;
      LeaseNews news = reader.Look(*spool, begun);
      const MutexLock lock(mutex_);
      reading_.since = absl::InfiniteDuration();
      const auto it = attempts_.find(name);
      if (it != attempts_.end()) Tell(*it->second, reader, std::move(news), begun);
    }
    const MutexLock lock(mutex_);
    std::erase_if(readers, [&](const auto& entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return !attempts_.contains(entry.first);
    });
    if (!stopping_) read_.WaitUntil(mutex_, Until(kPlayedEvery));
    if (stopping_) return;
  }
}

bool SlurmExecutor::OpenToRead(std::optional<Spool>& spool) {
  {
    const MutexLock lock(mutex_);
    if (!emptied_) return false;
    reading_.since = Now();
  }
  // A folder that was mounted anew needs to be opened anew.
  if (spool.has_value() && spool->Epoch().status().code() == absl::StatusCode::kUnavailable) {
    spool.reset();
  }
  if (!spool.has_value()) {
    absl::StatusOr<Spool> opened = Spool::Open(spool_path_);
    if (opened.ok()) spool.emplace(*std::move(opened));
  }
  const MutexLock lock(mutex_);
  reading_.since = absl::InfiniteDuration();
  return spool.has_value();
}

// The attempts whose folders are to be looked at now.
std::vector<std::string> SlurmExecutor::ToRead(absl::Duration now) {
  std::vector<std::string> names;
  const MutexLock lock(mutex_);
  for (const auto& [name, attempt] : attempts_) {
    if (attempt->over || attempt->released) continue;
    if (attempt->view.ordered == absl::InfiniteDuration()) continue;
    const bool played = attempt->view.claimed != absl::InfiniteDuration();
    if (played || now - attempt->looked >= kWaitingEvery) names.push_back(name);
  }
  return names;
}

void SlurmExecutor::Tell(Attempt& attempt, LeaseReader& reader, LeaseNews news,
                         absl::Duration now) {
  if (attempt.over || attempt.released) return;
  if (news.looked) attempt.looked = now;
  if (news.claim.has_value()) {
    attempt.view.claimed = Now();
    attempt.view.claim_node = news.claim->node;
    health_.Began(news.claim->node);
    attempt.counted = true;
    const std::string why = health_.WhyDrained(news.claim->node);
    if (!why.empty()) {
      return Lose(attempt, absl::StrCat("the node ", news.claim->node, " is drained: ", why));
    }
  }
  if (news.proof.has_value()) {
    const std::string why = health_.Prove(*news.proof, attempt.grader);
    if (!why.empty()) return Lose(attempt, why);
    reader.Trust();
  }
  const bool news_for_engine =
      !news.records.empty() || news.end.has_value() || !news.broken.empty();
  if (!news.records.empty() && attempt.view.heard == absl::InfiniteDuration()) {
    attempt.view.heard = now;
  }
  std::move(news.records.begin(), news.records.end(), std::back_inserter(attempt.records));
  if (!news.broken.empty()) {
    attempt.over = true;
    attempt.broken = std::move(news.broken);
  } else if (news.end.has_value() && !news.end->why.empty()) {
    attempt.view.given_back = Now();
    attempt.view.given_back_why = std::move(news.end->why);
    attempt.used = std::move(news.end);
  } else if (news.end.has_value()) {
    attempt.over = true;
    attempt.end = std::move(news.end);
  }
  if (news_for_engine) Wake();
}

}  // namespace myograde::server
