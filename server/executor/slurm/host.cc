#include "server/executor/slurm/lease_stream.h"

#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <optional>
#include <utility>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/artefact.h"
#include "server/base/child_process.h"
#include "server/base/plain_text.h"
#include "server/config/slurm_config.h"
#include "server/executor/slurm/srun.h"
#include "server/runner/log_keeper.h"

namespace myograde::server {
namespace {

constexpr int kTrouble = 4;
constexpr int kTurnMs = 500;
// While no job can be had: from one try to the next, doubled up to the most; and how long in all.
constexpr absl::Duration kRetry = absl::Seconds(5);
constexpr absl::Duration kMostRetry = absl::Minutes(1);
constexpr absl::Duration kSubmit = absl::Minutes(3);
// From a node's first word to its runner's.
constexpr absl::Duration kPrepare = absl::Minutes(15);
// For srun to cancel its job, and to tell Slurm of its end once the node has said its last word.
constexpr absl::Duration kCancel = absl::Milliseconds(500);
constexpr absl::Duration kLeave = absl::Minutes(1);
// For Slurm to know how a job ended.
constexpr absl::Duration kVerdict = absl::Seconds(20);
constexpr absl::Duration kCommand = absl::Seconds(10);

std::string SecondsText(absl::Duration time) {
  return absl::StrCat(absl::ToInt64Seconds(time), " s");
}

// What is wrong: what the node's program said last, else what srun did.
std::string SaidBy(const ChildProcess& srun) {
  const std::string said = srun.said();
  const size_t own = said.rfind("myograde-node: ");
  if (own != std::string::npos) return said.substr(own, said.find('\n', own) - own);
  const std::string line = WithoutName(LastLineOf(said), "srun");
  return line.empty() ? srun.Failure() : absl::StrCat("srun: ", line);
}

class FollowedLease {
 public:
  FollowedLease(ClusterOrder order, std::string text, int stop)
      : order_(std::move(order)), text_(std::move(text)), stop_(stop) {}

  absl::StatusOr<int> Run() {
    const Deadline submit(kSubmit);
    for (absl::Duration delay = kRetry;; delay = std::min(2 * delay, kMostRetry)) {
      ASSIGN_OR_RETURN(std::optional<int> ended, Attempt());
      if (!ended.has_value() && submit.over()) {
        ASSIGN_OR_RETURN(ended, Lose(absl::StrCat("no job could be submitted: ", here_.trouble)));
      }
      if (ended.has_value()) return *ended;
      RETURN_IF_ERROR(Tell());
      for (const Deadline nap(delay); !nap.over();) RETURN_IF_ERROR(Await(-1, -1));
    }
  }

 private:
  absl::Status Tell() {
    return WriteAll(STDOUT_FILENO, absl::StrCat(LeaseRecordToLine(here_), "\n"));
  }

  absl::StatusOr<std::optional<int>> Lose(const std::string& why, bool blamed = false) {
    here_.trouble.clear();
    here_.lost = PrintableUtf8(why);
    here_.blamed = blamed;
    RETURN_IF_ERROR(Tell());
    return 0;
  }

  // Waits for news of these, or a while. CancelledError: the daemon wants the lease to end.
  absl::Status Await(int out, int err) const {
    pollfd entries[] = {{stop_, POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}, {out, POLLIN, 0},
                        {err, POLLIN, 0}};
    poll(entries, std::size(entries), kTurnMs);
    const bool ends = entries[0].revents != 0 || entries[1].revents != 0;
    return ends ? absl::CancelledError("the daemon ended it") : absl::OkStatus();
  }

  // One srun. The exit status; nullopt: there was no job, and here_.trouble says why.
  absl::StatusOr<std::optional<int>> Attempt() {
    ASSIGN_OR_RETURN(Pipe in, MakePipe());
    ASSIGN_OR_RETURN(Pipe out, MakeOutputPipe());
    absl::StatusOr<ChildProcess> srun = ChildProcess::Start({.program = order_.srun.front(),
                                                             .words = order_.srun,
                                                             .in = in.read.get(),
                                                             .out = out.write.get(),
                                                             .environment = SlurmEnvironment()});
    if (!srun.ok()) {
      here_.trouble = std::string(srun.status().message());
      return std::nullopt;
    }
    in.read.reset();
    out.write.reset();
    LeaseStream stream(out.read.get(), in.write.get(),
                       static_cast<size_t>(order_.order.log_bytes) + LeaseStream::kMostBytes);
    const absl::Status followed = Follow(*srun, stream, out.read.get());
    in.write.reset();
    if (!end_.has_value() && !followed.ok()) {
      srun->Signal(SIGTERM);
      (void)Ended(*srun, kCancel);
    }
    if (end_.has_value()) {
      (void)Ended(*srun, kLeave);
      return TellEnd();
    }
    if (absl::IsDeadlineExceeded(followed)) {
      return Lose(std::string(followed.message()), /*blamed=*/begun_.has_value());
    }
    if (!followed.ok()) return followed;
    return Judge(*srun);
  }

  static bool Ended(ChildProcess& srun, absl::Duration patience) {
    const Deadline deadline(patience);
    while (!srun.Look()) {
      if (deadline.over()) return false;
      pollfd entry = {srun.err_fd(), POLLIN, 0};
      poll(&entry, 1, 10);
    }
    return true;
  }

  // Until srun has ended, or the node has said its last word. DeadlineExceededError: it waited for
  // longer than it may.
  absl::Status Follow(ChildProcess& srun, LeaseStream& stream, int out) {
    const Deadline queue(order_.queue_wait);
    bool open = true;
    while (!end_.has_value() && (open || !srun.Look())) {
      RETURN_IF_ERROR(Await(open ? out : -1, srun.err_fd()));
      if (open) {
        const absl::Status filled = stream.Fill();
        open = filled.ok();
        if (!open && !absl::IsOutOfRange(filled) && !absl::IsDataLoss(filled)) return filled;
      }
      while (!end_.has_value()) {
        ASSIGN_OR_RETURN(const std::optional<LeaseMessage> message, stream.Next());
        if (!message.has_value()) break;
        RETURN_IF_ERROR(Take(*message, stream));
      }
      srun.Look();
      if (!begun_.has_value() && queue.over()) return NotBegun();
      if (begun_.has_value() && !played_ && begun_->over()) {
        return absl::DeadlineExceededError(absl::StrCat(
            "job ", here_.job, " on ", here_.node, " has not begun to play after ",
            SecondsText(kPrepare)));
      }
    }
    return absl::OkStatus();
  }

  absl::Status NotBegun() const {
    const absl::StatusOr<SlurmJob> job = Job();
    const bool told = job.ok() && !job->reason.empty() && job->reason != "None";
    return absl::DeadlineExceededError(absl::StrCat(
        job.ok() ? absl::StrCat("job ", job->id) : "its job", " had not begun after ",
        SecondsText(order_.queue_wait), told ? absl::StrCat(" (", job->reason, ")") : ""));
  }

  absl::Status Take(const LeaseMessage& message, LeaseStream& stream) {
    if (message.kind == "node") {
      ASSIGN_OR_RETURN(const LeaseRecord record, LeaseRecordFromLine(message.bytes));
      const auto* node = std::get_if<NodeRecord>(&record);
      if (node == nullptr) return absl::DataLossError("the node described itself in a malformed record");
      here_ = *node;
      RETURN_IF_ERROR(Tell());
      if (begun_.has_value()) return absl::OkStatus();
      begun_.emplace(kPrepare);
      // Not earlier, as srun takes nothing before it has a node. One that has gone is told of by srun.
      (void)stream.Send("order", text_);
      return absl::OkStatus();
    }
    if (message.kind == "record") {
      played_ = true;
      return WriteAll(STDOUT_FILENO, absl::StrCat(message.bytes, "\n"));
    }
    if (message.kind == "want") return SendArtefact(stream);
    if (message.kind == "log") return KeepLog(message.bytes);
    if (message.kind != "end") return absl::DataLossError("the node sent a malformed message");
    ASSIGN_OR_RETURN(const nlohmann::json json, ParseJson(message.bytes, "a lease's end"));
    ConfigReader reader(json, "a lease's end");
    const int64_t wait_status = reader.Integer("wait_status", 0, INT32_MAX);
    const std::string said = reader.String("said");
    const std::string record = reader.String("record");
    RETURN_IF_ERROR(reader.Finish());
    end_ = std::pair(static_cast<int>(wait_status), said);
    if (record.empty()) return absl::OkStatus();
    return WriteAll(STDOUT_FILENO, absl::StrCat(record, "\n"));
  }

  absl::Status SendArtefact(LeaseStream& stream) {
    absl::Status sent;
    const absl::Status status =
        StreamArtefact(order_.order.artefact_dir, order_.artefact, [&](std::string_view piece) {
          sent = stream.Send("data", piece);
          return sent;
        });
    // Nobody takes it any more, and srun's end will say why.
    if (!sent.ok()) return absl::OkStatus();
    RETURN_IF_ERROR(status);
    (void)stream.Send("data", "");
    return absl::OkStatus();
  }

  // Under the name of its content, as a runner on this host keeps it.
  absl::Status KeepLog(std::string_view bytes) const {
    const size_t line = bytes.find('\n');
    if (line == std::string::npos) return absl::DataLossError("the node sent a log without a name");
    const std::string_view log = bytes.substr(line + 1);
    EpisodeLogInfo info;
    info.sha256 = bytes.substr(0, line);
    info.packed_bytes = std::ssize(log);
    return LogKeeper::Keep(order_.order.log_dir, order_.order.lease, info, log);
  }

  int TellEnd() const {
    const auto& [wait_status, said] = *end_;
    std::fputs(Sanitized(said).c_str(), stderr);
    if (WIFEXITED(wait_status)) return WEXITSTATUS(wait_status);
    std::fprintf(stderr, "the runner was killed by signal %d\n", WTERMSIG(wait_status));
    return kTrouble;
  }

  // The lease's job, as Slurm shows it. NotFoundError: it shows none.
  absl::StatusOr<SlurmJob> Job() const {
    ASSIGN_OR_RETURN(const std::string answer,
                     RunSlurm(order_.squeue.front(),
                              {order_.squeue.begin() + 1, order_.squeue.end()}, kCommand));
    ASSIGN_OR_RETURN(const std::vector<SlurmJob> jobs, ParseQueue(answer));
    // The newest: those of earlier tries, which Slurm refused, may still be shown.
    const SlurmJob* newest = nullptr;
    for (const SlurmJob& job : jobs) {
      if (job.comment != order_.comment) continue;
      if (newest == nullptr || std::pair(job.id.size(), job.id) > std::pair(newest->id.size(), newest->id)) {
        newest = &job;
      }
    }
    if (newest == nullptr) return absl::NotFoundError("the cluster shows no such job");
    return *newest;
  }

  // What srun's end means, without a last word of the node's.
  absl::StatusOr<std::optional<int>> Judge(const ChildProcess& srun) {
    const Deadline deadline(kVerdict);
    absl::StatusOr<SlurmJob> job = Job();
    while ((job.ok() ? !job->over() : !absl::IsNotFound(job.status())) && !deadline.over()) {
      RETURN_IF_ERROR(Await(-1, -1));
      job = Job();
    }
    const bool begun = begun_.has_value();
    // One that Slurm refuses it may show as failed.
    if (!begun && (!job.ok() || job->node.empty())) {
      here_.trouble = PrintableUtf8(SaidBy(srun));
      return std::nullopt;
    }
    if (job.ok()) {
      here_.job = job->id;
      if (here_.node.empty() && IsNodeName(job->node)) here_.node = job->node;
    }
    std::string why = absl::StrCat("job ", here_.job, here_.node.empty() ? "" : " on ", here_.node, " ",
                                   job.ok() ? job->HowItEnded() : "was lost",
                                   begun ? " before its lease had ended" : " before it took its lease");
    if (job.ok() && job->AtALimit()) return absl::InternalError(why);
    if (!srun.succeeded() && (!job.ok() || job->state == "FAILED")) {
      absl::StrAppend(&why, ": ", SaidBy(srun));
    }
    // A program that never came to play is not there, or can't run.
    const bool blamed = !played_ && job.ok() && job->state == "FAILED";
    return Lose(why, blamed);
  }

  const ClusterOrder order_;
  const std::string text_;
  const int stop_;
  NodeRecord here_;
  std::optional<Deadline> begun_;  // since the node's first word: until its runner's
  bool played_ = false;
  std::optional<std::pair<int, std::string>> end_;  // of the runner: wait status, and what it said
};

absl::StatusOr<int> Follow(const std::string& path, int stop) {
  ASSIGN_OR_RETURN(std::string text, ReadFile(path, LeaseStream::kMostBytes));
  ASSIGN_OR_RETURN(ClusterOrder order, ClusterOrderFromText(text));
  if (order.srun.empty() || order.squeue.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": names no commands"));
  }
  return FollowedLease(std::move(order), std::move(text), stop).Run();
}

}  // namespace

int FollowLease(const std::string& order, int stop) {
  const absl::StatusOr<int> ended = Follow(order, stop);
  if (ended.ok()) return *ended;
  std::fprintf(stderr, "myograde-node: %s\n",
               Sanitized(std::string(ended.status().message())).c_str());
  return kTrouble;
}

}  // namespace myograde::server
