#include "server/executor/slurm/slurm_executor.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/base/output_tail.h"
#include "server/base/random_bytes.h"
#include "server/executor/slurm/slurm_runner.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kJudgeEvery = absl::Milliseconds(100);
// A thread that is busy with one thing for so long hangs.
constexpr absl::Duration kHangs = absl::Seconds(30);
constexpr size_t kEpochBytes = 16;
constexpr size_t kNonceBytes = 8;

absl::StatusOr<std::string> RandomHex(size_t size) {
  ASSIGN_OR_RETURN(const std::string bytes, RandomBytes(size));
  return HexOf({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
}

std::string SpoolPath(const SlurmOptions& options) {
  return options.config.shared_dir.empty()
             ? options.data_dir + "/cluster"
             : absl::StrCat(options.config.shared_dir, "/myograde-", options.store_id);
}

}  // namespace

absl::StatusOr<std::unique_ptr<SlurmExecutor>> SlurmExecutor::Make(SlurmOptions options) {
  RETURN_IF_ERROR(CheckSlurmIsUsable(options.config, "server.json: slurm"));
  ASSIGN_OR_RETURN(std::string epoch, RandomHex(kEpochBytes));
  std::unique_ptr<SlurmExecutor> executor(
      new SlurmExecutor(std::move(options), std::move(epoch)));
  RETURN_IF_ERROR(executor->Begin());
  return executor;
}

SlurmExecutor::SlurmExecutor(SlurmOptions options, std::string epoch)
    : options_(std::move(options)),
      epoch_(std::move(epoch)),
      job_name_("myograde-" + options_.store_id),
      spool_path_(SpoolPath(options_)),
      limits_({.queue_wait = options_.config.queue_wait, .claim = options_.config.claim}),
      commands_(
          options_.config, job_name_,
          [this] {
            const MutexLock lock(mutex_);
            return stopping_;
          },
          options_.command_deadline),
      writer_(options_.data_dir, options_.grader),
      // A job's script holds its leases' tokens, and comes to the node as a whole.
      jobs_(options_.config.shared_dir.empty() ? 1 : options_.config.array_size) {}

absl::Status SlurmExecutor::Begin() {
  wake_ = Fd(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!wake_.valid()) {
    return absl::InternalError(absl::StrCat("can't make an event: ", std::strerror(errno)));
  }
  if (!options_.held_back.empty()) return absl::OkStatus();
  // On the daemon's own disk; a shared folder may hang, and is for the threads.
  if (options_.config.shared_dir.empty()) {
    RETURN_IF_ERROR(OpenToWrite());
    door_ = std::make_unique<SpoolDoor>(*spool_, options_.log_bytes);
  }
  talking_thread_ = std::thread([this] { TalkToSlurm(); });
  writing_thread_ = std::thread([this] { WriteSpool(); });
  reading_thread_ = std::thread([this] { ReadSpool(); });
  return absl::OkStatus();
}

SlurmExecutor::~SlurmExecutor() {
  {
    const MutexLock lock(mutex_);
    stopping_ = true;
    talk_.NotifyAll();
    write_.NotifyAll();
    read_.NotifyAll();
  }
  for (std::thread* thread : {&talking_thread_, &writing_thread_, &reading_thread_}) {
    if (thread->joinable()) thread->join();
  }
}

absl::Duration SlurmExecutor::Now() const { return SystemClock().Monotonic(); }

void SlurmExecutor::Wake() const {
  const uint64_t one = 1;
  // Full, it is readable already.
  while (::write(wake_.get(), &one, sizeof(one)) < 0 && errno == EINTR) {
  }
}

absl::StatusOr<std::unique_ptr<Runner>> SlurmExecutor::Start(const LeaseOrder& order,
                                                             const LeaseSubject& subject) {
  if (!order.replay.empty() || subject.artefact.empty()) {
    return absl::FailedPreconditionError("only leases of submissions run on the cluster");
  }
  ASSIGN_OR_RETURN(std::string nonce, RandomHex(kNonceBytes));
  auto attempt = std::make_shared<Attempt>();
  attempt->name = absl::StrCat(subject.lease, "-", subject.attempt, "-", nonce);
  attempt->evaluation = subject.evaluation;
  attempt->needs = NeedsOf(options_.config, order.track.budgets, subject.wall);
  attempt->artefact = subject.artefact;
  attempt->artefact_dir = order.artefact_dir;
  NodeOrder& sent = attempt->order;
  sent.name = attempt->name;
  sent.epoch = epoch_;
  sent.order = order;
  sent.order.artefact_dir = sent.order.work_dir = sent.order.cache_dir = sent.order.log_dir = "";
  sent.order.slot_mark = "";
  sent.order.uid = -1;
  sent.order.slot = 0;
  sent.order.pinned = false;  // several leases may share a node
  for (size_t i = 0; i < order.runtimes.size() && i < subject.runtimes.size(); ++i) {
    sent.runtimes.push_back(
        {subject.runtimes[i].first, subject.runtimes[i].second, order.runtimes[i]});
  }
  sent.wall_s = absl::ToDoubleSeconds(subject.wall);
  sent.uid_base = options_.uid_base;
  sent.logs = !order.log_dir.empty();
  const MutexLock lock(mutex_);
  attempt->view.started = Now();
  sent.prove_again = health_.ToProveAgain();
  tasks_.push_back({Task::Kind::kWrite, attempt->name});
  attempts_[attempt->name] = attempt;
  write_.NotifyAll();
  return std::make_unique<SlurmRunner>(*this, std::move(attempt));
}

void SlurmExecutor::Release(Attempt& attempt) {
  const MutexLock lock(mutex_);
  if (attempt.released) return;
  attempt.released = true;
  const bool ended = attempt.end.has_value();
  jobs_.Remove(attempt.name, /*leaves=*/ended, Now());
  if (door_ != nullptr) door_->Close(attempt.name);
  if (attempt.counted) health_.Left(attempt.view.claim_node);
  attempt.counted = false;
  if (!ended) {
    urgent_.push_back({Task::Kind::kStop, attempt.name});
    write_.NotifyAll();
  }
  talk_.NotifyAll();
}

bool SlurmExecutor::IsGone(const Attempt& attempt) const {
  const MutexLock lock(mutex_);
  // Its node's last word, or the cluster's.
  return attempt.end.has_value() || (attempt.released && jobs_.gone(attempt.name, Now()));
}

void SlurmExecutor::Attend() {
  uint64_t count;
  while (::read(wake_.get(), &count, sizeof(count)) < 0 && errno == EINTR) {
  }
  const absl::Duration now = Now();
  const MutexLock lock(mutex_);
  if (now - judged_ < kJudgeEvery) return;
  judged_ = now;
  for (const auto& [name, attempt] : attempts_) {
    if (!attempt->over && !attempt->released) Judge(*attempt, now);
  }
  Clear(now);
}

void SlurmExecutor::Lose(Attempt& attempt, const std::string& why) {
  if (attempt.over) return;
  attempt.over = true;
  attempt.lost = why;
  Wake();
}

void SlurmExecutor::Judge(Attempt& attempt, absl::Duration now) {
  AttemptView& view = attempt.view;
  if (const JobView* job = jobs_.Find(attempt.name)) {
    view.job = *job;
    if (job->state == JobState::kRunning) view.running = std::min(view.running, job->seen);
  } else {
    view.job = {.id = "",
                .node = "",
                .reason = "",
                .wait_status = 0,
                .seen = -absl::InfiniteDuration(),
                .over_since = absl::InfiniteDuration()};
  }
  const bool ordered = view.ordered != absl::InfiniteDuration();
  view.submit_why = ordered ? jobs_.trouble() : spool_trouble_;
  const absl::Duration since = ordered ? jobs_.trouble_since() : spool_trouble_since_;
  const bool failing = !view.submit_why.empty() && view.job.id.empty();
  view.submit_trouble = failing ? std::max(since, view.started) : absl::InfiniteDuration();
  view.looked = attempt.looked;
  const AttemptVerdict verdict = JudgeAttempt(view, limits_, now);
  if (verdict.kind == AttemptVerdict::Kind::kGoesOn) return;
  if (!verdict.blame_node.empty()) health_.Ended(verdict.blame_node, /*badly=*/true, verdict.why);
  if (verdict.kind == AttemptVerdict::Kind::kLost) return Lose(attempt, verdict.why);
  // As if its runner had been killed, which it was.
  attempt.over = true;
  attempt.end.emplace();
  attempt.end->wait_status = SIGKILL;
  attempt.end->stderr_tail = verdict.why;
  Wake();
}

// Attempts that the engine is done with, and whose jobs are gone.
void SlurmExecutor::Clear(absl::Duration now) {
  std::erase_if(attempts_, [&](const auto& entry) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const Attempt& attempt = *entry.second;
    if (!attempt.released || !jobs_.gone(attempt.name, now)) return false;
    jobs_.Forget(attempt.name);
    urgent_.push_back({Task::Kind::kRemove, attempt.name});
    write_.NotifyAll();
    return true;
  });
}

std::string SlurmExecutor::CannotStart() const {
  if (!options_.held_back.empty()) return options_.held_back;
  const MutexLock lock(mutex_);
  const absl::Duration now = Now();
  for (const Busy& busy : {writing_, reading_}) {
    if (now - busy.since >= kHangs) {
      return absl::StrCat("the folder ", spool_path_, " does not answer");
    }
  }
  if (!spool_trouble_.empty()) return spool_trouble_;
  if (!queue_trouble_.empty()) return absl::StrCat("the cluster does not answer: ", queue_trouble_);
  if (!jobs_.trouble().empty()) {
    return absl::StrCat("the cluster takes no jobs: ", jobs_.trouble());
  }
  if (std::string why = WhyNoNode(); !why.empty()) return why;
  return emptied_ ? "" : "what an earlier daemon left in the spool is being removed";
}

std::string SlurmExecutor::WhyNoNode() const {
  const auto drained = [&](const std::string& node) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return health_.drained(node);
  };
  const std::vector<std::string> names = health_.Drained();
  if (names.empty() || !usable_nodes_.has_value() ||
      !std::all_of(usable_nodes_->begin(), usable_nodes_->end(), drained)) {
    return "";
  }
  return absl::StrCat("all nodes of the cluster are drained or down; ", names.front(), ": ",
                      health_.WhyDrained(names.front()),
                      "; repair them, then \"myograde cluster admit NODE\"");
}

void SlurmExecutor::NoteEnd(const std::string& node, bool fault) {
  if (node.empty()) return;
  const MutexLock lock(mutex_);
  health_.Ended(node, fault, "a fault of the grader's");
}

std::vector<NodeView> SlurmExecutor::Nodes() const {
  const MutexLock lock(mutex_);
  return health_.Views();
}

absl::Status SlurmExecutor::Drain(const std::string& node, const std::string& why) {
  if (!IsNodeName(node)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", PrintableUtf8(node),
                                                   "\" is no name of a node"));
  }
  const MutexLock lock(mutex_);
  health_.Drain(node, why);
  return absl::OkStatus();
}

absl::Status SlurmExecutor::Admit(const std::string& node) {
  if (!IsNodeName(node)) {
    return absl::InvalidArgumentError(absl::StrCat("\"", PrintableUtf8(node),
                                                   "\" is no name of a node"));
  }
  const MutexLock lock(mutex_);
  health_.Admit(node);
  return absl::OkStatus();
}

std::vector<DrainedNode> SlurmExecutor::TakeDrained() {
  const MutexLock lock(mutex_);
  return health_.TakeDrained();
}

}  // namespace myograde::server
