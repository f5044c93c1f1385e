// The loop around the core, and the requests of other threads; concurrent ones are written
// together.
#include "server/engine/engine.h"

#include <poll.h>
#include <sys/eventfd.h>

#include <algorithm>

#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "server/artefact/adapters.h"
#include "server/engine/rejudges.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxCommands = 1024;
// After its grace a stopping runner is killed, and dead soon after.
constexpr absl::Duration kAfterGrace = absl::Milliseconds(250);
constexpr char kRejudger[] = "daemon";  // in audit rows

absl::Status Stopping() {
  return absl::CancelledError("the daemon is stopping; try again when it is back");
}

// Makes the submitter the first member of the submission's team, where that is asked for.
absl::Status Found(Transaction& writer, const NewSubmission& submission) {
  if (!submission.founding.has_value()) return absl::OkStatus();
  const Founding& founding = *submission.founding;
  if (founding.needed) return writer.teams.Found(submission.team, founding.person, founding.most);
  const absl::Status status = writer.Part([&](Transaction& part) {
    return part.teams.Found(submission.team, founding.person, founding.most);
  });
  return absl::IsFailedPrecondition(status) ? absl::OkStatus() : status;
}

using EvaluationIds = std::vector<int64_t>;

absl::Status EnqueueAll(EngineCore& core, const EvaluationIds& evaluations) {
  for (const int64_t evaluation : evaluations) {
    RETURN_IF_ERROR(core.Enqueue(evaluation));
  }
  return absl::OkStatus();
}

}  // namespace

CommandQueue::CommandQueue(size_t capacity)
    : capacity_(capacity), wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}

void CommandQueue::Wake() {
  const uint64_t one = 1;
  [[maybe_unused]] const ssize_t n = write(wake_.get(), &one, sizeof(one));
}

absl::Status CommandQueue::Call(std::function<void(Answer)> command, absl::Duration timeout) {
  std::future<absl::Status> answer;
  {
    const MutexLock lock(mutex_);
    if (closed_) return Stopping();
    if (entries_.size() >= capacity_) {
      return absl::ResourceExhaustedError("too many commands are waiting; try again in a second");
    }
    entries_.push_back({std::move(command), std::make_shared<std::promise<absl::Status>>()});
    answer = entries_.back().answer->get_future();
  }
  Wake();
  if (answer.wait_for(absl::ToChronoNanoseconds(timeout)) != std::future_status::ready) {
    return absl::DeadlineExceededError(
        "the daemon was too busy to answer in time; check the status before you try again");
  }
  return answer.get();
}

int CommandQueue::RunAll() {
  uint64_t count = 0;
  [[maybe_unused]] const ssize_t n = read(wake_.get(), &count, sizeof(count));
  std::deque<Entry> entries;
  {
    const MutexLock lock(mutex_);
    entries.swap(entries_);
  }
  for (Entry& entry : entries) {
    entry.command([answer = entry.answer](absl::Status status) { answer->set_value(status); });
  }
  return static_cast<int>(entries.size());
}

void CommandQueue::Close() {
  const MutexLock lock(mutex_);
  closed_ = true;
  for (Entry& entry : entries_) entry.answer->set_value(Stopping());
  entries_.clear();
}

Engine::Engine(EngineOptions options, StoreWriter& disk, ReaderPool& readers, Executor& executor,
               const Clock& clock)
    : readers_(readers),
      clock_(clock),
      commands_(kMaxCommands),
      core_(std::move(options), disk, readers, executor, clock) {}

void Engine::Stop() {
  stop_ = true;
  commands_.Wake();
}

void Engine::SetHeartbeat(absl::Duration interval, std::function<void()> alive) {
  beat_interval_ = interval;
  next_beat_ = clock_.Monotonic();
  alive_ = std::move(alive);
}

void Engine::Beat() {
  const absl::Duration now = clock_.Monotonic();
  if (now < next_beat_) return;
  alive_();
  next_beat_ = now + beat_interval_;
}

absl::Status Engine::Run() {
  while (!stop_) {
    Beat();
    commands_.RunAll();
    const absl::StatusOr<absl::Duration> wait = core_.RunOnce();
    if (!wait.ok()) {
      commands_.Close();
      (void)core_.FinishShutdown();  // the first error is the one to return
      return wait.status();
    }
    Poll(std::min(*wait, beat_interval_));
  }
  commands_.Close();
  core_.BeginShutdown();
  const absl::Duration deadline = clock_.Monotonic() + Runner::kCleanUpGrace + kAfterGrace;
  while (!core_.idle() && clock_.Monotonic() < deadline) {
    const absl::StatusOr<absl::Duration> wait = core_.RunOnce();
    if (!wait.ok()) break;
    Poll(std::min(*wait, deadline - clock_.Monotonic()));
  }
  return core_.FinishShutdown();
}

void Engine::Poll(absl::Duration timeout) {
  std::vector<pollfd> fds = {{commands_.wake_fd(), POLLIN, 0}};
  core_.AddDescriptors(fds);
  // Rounded up: a deadline that is 0.3 ms away must not spin.
  const int ms = static_cast<int>(absl::ToInt64Milliseconds(
      absl::Ceil(std::max(timeout, absl::ZeroDuration()), absl::Milliseconds(1))));
  poll(fds.data(), fds.size(), ms);
}

absl::Status Engine::Change(StoreChange change, absl::Duration timeout,
                            std::function<absl::Status()> effect) {
  return commands_.Call(
      [this, change = std::move(change), effect = std::move(effect)](CommandQueue::Answer answer) {
        core_.Ask({change, effect, std::move(answer)});
      },
      timeout);
}

absl::Status Engine::SetNode(const std::string& node, bool drained, const std::string& why,
                             const std::string& who, absl::Duration timeout) {
  return Change([=](Transaction& writer) { return writer.blocks.SetNode(node, drained, why, who); },
                timeout, [=, this] {
                  return drained ? core_.executor().Drain(node, why) : core_.executor().Admit(node);
                });
}

absl::StatusOr<bool> Engine::AddArtefact(const ArtefactRow& artefact, const NewUpload& upload,
                                         const UnsubmittedLimits& limits, absl::Duration timeout) {
  return Change<bool>(
      [artefact, upload, limits](Transaction& writer) -> absl::StatusOr<bool> {
        ASSIGN_OR_RETURN(const bool is_new, writer.content.AddArtefact(artefact));
        RETURN_IF_ERROR(writer.content.AddUpload(artefact, upload, limits));
        return is_new;
      },
      timeout);
}

absl::StatusOr<Accepted> Engine::Admit(std::function<absl::StatusOr<Accepted>(Transaction&)> add,
                                       absl::Duration timeout) {
  return Change<Accepted>(std::move(add), timeout, [this](const Accepted& accepted) {
    return accepted.is_new() ? core_.Enqueue(accepted.evaluation) : absl::OkStatus();
  });
}

absl::StatusOr<Accepted> Engine::Submit(const NewSubmission& submission,
                                        const AdmissionRules& rules, const std::string& who,
                                        absl::Duration timeout) {
  return Admit([this, submission, rules, who](Transaction& writer) {
    return writer.submissions.Once(who, submission.request_key, [&]() -> absl::StatusOr<Accepted> {
      // Files are removed on the loop's thread too, so those that are there now stay.
      RETURN_IF_ERROR(HasArtefactFiles(core_.options().data_dir, submission.artefact));
      RETURN_IF_ERROR(Found(writer, submission));
      return writer.submissions.Accept(submission, rules, who);
    });
  }, timeout);
}

absl::StatusOr<bool> Engine::ChangeTeams(std::function<absl::StatusOr<bool>(Transaction&)> change,
                                         absl::Duration timeout) {
  return Change<bool>(std::move(change), timeout, [this](bool) {
    core_.FollowTeams();
    return absl::OkStatus();
  });
}

absl::StatusOr<Accepted> Engine::Rerun(const NewRerun& rerun, const std::string& who,
                                       bool organiser, const RerunLimits& limits,
                                       absl::Duration timeout) {
  return Admit(
      [this, rerun, who, organiser, limits](Transaction& writer) {
        return writer.submissions.Once(who, rerun.request_key, [&]() -> absl::StatusOr<Accepted> {
          RETURN_IF_ERROR(HasArtefactFiles(core_.options().data_dir, rerun.artefact));
          RETURN_IF_ERROR(writer.submissions.CheckReruns(rerun.submission, who, organiser, limits));
          return writer.evaluations.Add({.submission = rerun.submission,
                                         .kind = EvaluationKind::kRerun,
                                         .grader_json = rerun.grader_json},
                                        rerun.blocks, who);
        });
      },
      timeout);
}

absl::StatusOr<CancelReport> Engine::Cancel(const CancelOrder& order, absl::Duration timeout) {
  const auto report = std::make_shared<CancelReport>();
  RETURN_IF_ERROR(commands_.Call(
      [this, order, report](CommandQueue::Answer answer) {
        core_.Cancel(order, [report, answer](absl::StatusOr<CancelReport> done) {
          if (done.ok()) *report = *done;
          answer(done.status());
        });
      },
      timeout));
  return *report;
}

// Rejudges (store/rejudges.h).

nlohmann::json Engine::HostBuild() const {
  return WithRuntimes(GraderBuild(core_.options().cache_dir, AdapterNames()),
                      RuntimeDigests(core_.runtimes()));
}

absl::StatusOr<RejudgePlan> Engine::CreateRejudge(const NewRejudge& asked, const SignDocument& sign,
                                                  const std::string& who, absl::Duration timeout) {
  NewRejudge rejudge = asked;
  if (rejudge.grader_json.empty()) rejudge.grader_json = CanonicalJson(HostBuild());
  ASSIGN_OR_RETURN(RejudgePlan plan, readers_.Read<RejudgePlan>([&](const Transaction& reader) {
                     return PlanRejudge(reader, rejudge, core_.options().data_dir);
                   }));
  ASSIGN_OR_RETURN(plan.rejudge,
                   Change<int64_t>(
                       [=](Transaction& writer) -> absl::StatusOr<int64_t> {
                         ASSIGN_OR_RETURN(const RejudgeRow row,
                                          writer.rejudges.Add(rejudge, sign, who));
                         return row.id;
                       },
                       timeout));
  return plan;
}

absl::StatusOr<RejudgeDone> Engine::EndRejudge(bool apply, const RejudgeAct& act,
                                               const SignDocument& sign, const std::string& who,
                                               absl::Duration timeout, AfterRejudge after) {
  return Change<RejudgeDone>(
      [=](Transaction& writer) {
        return writer.rejudges.End(apply, act, sign, who);
      },
      timeout,
      [this, after = std::move(after)](const RejudgeDone& done) {
        core_.StopEnded(done.cancelled);
        if (after) after(done);
        return absl::OkStatus();
      });
}

absl::Status Engine::AddRejudgeItems(std::vector<NewRejudgeItem> items, absl::Duration timeout) {
  const auto to_queue = std::make_shared<EvaluationIds>();
  return Change(
      [=, items = std::move(items)](Transaction& writer) {
        to_queue->clear();
        absl::Status passing;
        for (const NewRejudgeItem& item : items) {
          const absl::Status added = writer.Part([&](Transaction& part) -> absl::Status {
            ASSIGN_OR_RETURN(const Accepted accepted, part.rejudges.AddItem(item, kRejudger));
            if (!accepted.blocks.empty()) to_queue->push_back(accepted.evaluation);
            return absl::OkStatus();
          });
          if (MayPass(added) || IsBrokenStore(added)) {
            passing.Update(added);
          } else if (!added.ok()) {
            // One that was dropped meanwhile takes no more items.
            spdlog::warn("can't add an item: {}", std::string(added.message()));
          }
        }
        return passing;
      },
      timeout, [this, to_queue] { return EnqueueAll(core_, *to_queue); });
}

}  // namespace myograde::server
