#include "server/executor/slurm/slurm_executor.h"

#include <algorithm>
#include <chrono>
#include <utility>
#include <variant>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>
#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/base/plain_text.h"
#include "server/base/secret.h"
#include "server/executor/slurm/lease_stream.h"
#include "server/executor/slurm/srun.h"
#include "server/runner/runner_process.h"

namespace myograde::server {
namespace {

constexpr size_t kCommentBytes = 8;
constexpr absl::Duration kCommand = absl::Seconds(30);
// Between two looks at the queue and at the nodes: while something is wrong, and otherwise.
constexpr auto kWatchAgain = std::chrono::seconds(5);
constexpr auto kWatchEvery = std::chrono::minutes(1);

const std::string& OrElse(const std::string& own, const std::string& fallback) {
  return own.empty() ? fallback : own;
}

absl::Status CheckNodeName(const std::string& node) {
  if (IsNodeName(node)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", PrintableUtf8(node), "\" is not a name of a node"));
}

}  // namespace

// A lease on the cluster, as the engine sees it.
class SlurmExecutor::Lease : public RunnerProcess {
 public:
  Lease(SlurmExecutor& executor, std::string comment, Started process)
      : RunnerProcess(std::move(process)), executor_(executor), comment_(std::move(comment)) {
    const MutexLock lock(executor_.mutex_);
    executor_.leases_[comment_] = this;
  }
  ~Lease() override {
    Kill();
    const MutexLock lock(executor_.mutex_);
    executor_.leases_.erase(comment_);
    if (!here_.node.empty()) executor_.health_.Left(here_.node);
  }

  absl::StatusOr<std::vector<LeaseRecord>> Read() override {
    ASSIGN_OR_RETURN(std::vector<LeaseRecord> records, RunnerProcess::Read());
    std::erase_if(records, [&](const LeaseRecord& record) {
      const auto* node = std::get_if<NodeRecord>(&record);
      if (node != nullptr) Take(*node);
      return node != nullptr;
    });
    begun_ = begun_ || !records.empty();
    return records;
  }
  // One that was lost is for the engine to return.
  bool finished() override { return RunnerProcess::finished() && lost().empty(); }
  bool begun() const override { return begun_; }
  std::string lost() const override { return here_.lost; }
  RunnerSite site() const override { return static_cast<const RunnerSite&>(here_); }

  // Why no job can be had for it; "": it has one, or waits for one.
  const std::string& trouble() const { return here_.trouble; }

 private:
  void Take(const NodeRecord& record) {
    const MutexLock lock(executor_.mutex_);
    NodeHealth& health = executor_.health_;
    if (here_.trouble.empty() && !record.trouble.empty()) {
      spdlog::error("the cluster takes no jobs: {}", record.trouble);
    }
    if (here_.node != record.node) {
      if (!here_.node.empty()) health.Left(here_.node);
      if (!record.node.empty()) health.Began(record.node);
    }
    const std::string lost = here_.lost;
    here_ = record;
    if (!lost.empty()) here_.lost = lost;
    if (record.node.empty()) return;
    if (!record.unfit.empty()) health.Unfit(record.node, record.unfit);
    if (record.blamed) health.Ended(record.node, /*badly=*/true, record.lost);
    const std::map<std::string, std::string> drained = health.Drained();
    const auto found = drained.find(record.node);
    if (found != drained.end()) executor_.news_.NotifyAll();
    if (found != drained.end() && !begun_) {
      here_.lost = absl::StrCat("the node ", record.node, " is drained: ", found->second);
    } else if (!record.processor.empty()) {
      health.Proved(record.node, record.processor);
    }
  }

  SlurmExecutor& executor_;
  const std::string comment_;  // of its job
  NodeRecord here_;
  bool begun_ = false;
};

SlurmExecutor::SlurmExecutor(SlurmOptions options)
    : options_(std::move(options)),
      job_name_("myograde-" + options_.store_id),
      unseen_("jobs of an earlier daemon are being cancelled") {
  if (options_.held_back.empty()) watching_ = std::thread([this] { Watch(); });
}

SlurmExecutor::~SlurmExecutor() {
  {
    const MutexLock lock(mutex_);
    stopping_ = true;
    news_.NotifyAll();
  }
  if (watching_.joinable()) watching_.join();
}

absl::StatusOr<std::unique_ptr<Runner>> SlurmExecutor::Start(const LeaseOrder& order,
                                                             const LeaseSubject& subject) {
  if (!order.replay.empty() || subject.artefact.empty()) {
    return absl::FailedPreconditionError("only leases of submissions run on the cluster");
  }
  ASSIGN_OR_RETURN(const std::string random, RandomBytes(kCommentBytes));
  const std::string comment = absl::StrCat(
      order.lease, "-", ToHex({reinterpret_cast<const uint8_t*>(random.data()), random.size()}));
  ASSIGN_OR_RETURN(const std::string text, OrderText(order, subject, comment));
  RETURN_IF_ERROR(MakeWorkDir(order.work_dir));
  {
    // Its job, of this comment, is none to cancel from now on.
    const MutexLock lock(mutex_);
    leases_.emplace(comment, nullptr);
  }
  absl::StatusOr<RunnerProcess::Started> process =
      RunnerProcess::Launch(order, "myograde-node", text);
  if (process.ok()) return std::make_unique<Lease>(*this, comment, *std::move(process));
  CleanUp(order.work_dir);
  const MutexLock lock(mutex_);
  leases_.erase(comment);
  return process.status();
}

absl::StatusOr<std::string> SlurmExecutor::OrderText(const LeaseOrder& order,
                                                     const LeaseSubject& subject,
                                                     const std::string& comment) {
  const SlurmConfig& config = options_.config;
  ClusterOrder sent;
  sent.order = order;
  sent.order.log_bytes = options_.log_bytes;
  sent.artefact = subject.artefact;
  sent.runtimes = subject.runtimes;
  sent.grader = CanonicalJson(options_.grader({order.adapter}));
  sent.uid_base = options_.uid_base;
  sent.queue_wait = config.queue_wait;
  sent.comment = comment;
  const auto command = [&](const char* name) {
    // If it can't be found, the lease's process says so, and tries again.
    return SlurmCommand(config, name).value_or(name);
  };
  sent.squeue = QueueWords(job_name_);
  sent.squeue.insert(sent.squeue.begin(), command("squeue"));
  ASSIGN_OR_RETURN(const std::string setpriv, FindProgram("setpriv"));
  // Ends srun, and so the job, should the lease's process be killed.
  sent.srun = {setpriv, "--pdeathsig", "TERM", command("srun")};
  for (std::string& word : JobWords(config, order.track.budgets, subject.wall)) {
    sent.srun.push_back(std::move(word));
  }
  {
    const MutexLock lock(mutex_);
    sent.prove_again = health_.ToProveAgain();
    if (const auto drained = health_.Drained(); !drained.empty()) {
      const auto name = [](std::string* out, const auto& node) { out->append(node.first); };
      sent.srun.push_back("--exclude=" + absl::StrJoin(drained, ",", name));
    }
  }
  sent.srun.insert(
      sent.srun.end(),
      {"--job-name=" + job_name_, "--comment=" + sent.comment, "--export=NONE", "--chdir=/",
       "--mpi=none", "--input=all", "--output=all", "--error=all",
       OrElse(config.bin_dir, options_.bin_dir) + "/myograde-node", "--play", "--cache",
       OrElse(config.cache_dir, options_.cache_dir), "--configs", options_.configs_dir});
  if (!config.node_dir.empty()) {
    sent.srun.insert(sent.srun.end(), {"--node-dir", config.node_dir});
  }
  return ClusterOrderToText(sent);
}

absl::StatusOr<std::string> SlurmExecutor::Ask(const std::string& name,
                                               std::vector<std::string> words) const {
  ASSIGN_OR_RETURN(const std::string path, SlurmCommand(options_.config, name));
  return RunSlurm(path, std::move(words), kCommand, [this] {
    const MutexLock lock(mutex_);
    return stopping_;
  });
}

// The nodes of the partition that Slurm gives jobs.
absl::StatusOr<std::set<std::string>> SlurmExecutor::UsableNodes() const {
  const std::string& partition = options_.config.partition;
  std::vector<std::string> words = {"--noheader", "--Node", "--format=%N|%P|%T"};
  if (!partition.empty()) words.push_back("--partition=" + partition);
  ASSIGN_OR_RETURN(const std::string answer, Ask("sinfo", std::move(words)));
  std::set<std::string> nodes;
  for (const absl::string_view line : absl::StrSplit(answer, '\n', absl::SkipWhitespace())) {
    const std::vector<std::string> parts = absl::StrSplit(line, '|');
    if (parts.size() != 3) return absl::InternalError(absl::StrCat("sinfo printed \"", line, "\""));
    // The default partition has a star.
    if (partition.empty() && !absl::EndsWith(parts[1], "*")) continue;
    if (!absl::StartsWith(parts[2], "down") && !absl::StartsWith(parts[2], "drain")) {
      nodes.insert(parts[0]);
    }
  }
  return nodes;
}

// Cancels the store's jobs that no lease of this daemon's waits for: an earlier one left them, or their
// srun was killed before Slurm heard of its end. How many there were.
absl::StatusOr<size_t> SlurmExecutor::CancelStrays() const {
  ASSIGN_OR_RETURN(const std::string answer, Ask("squeue", QueueWords(job_name_)));
  ASSIGN_OR_RETURN(const std::vector<SlurmJob> jobs, ParseQueue(answer));
  std::vector<std::string> words = {"--quiet"};
  {
    const MutexLock lock(mutex_);
    for (const SlurmJob& job : jobs) {
      if (!job.over() && !leases_.contains(job.comment)) words.push_back(job.id);
    }
  }
  const size_t strays = words.size() - 1;
  if (strays > 0) RETURN_IF_ERROR(Ask("scancel", std::move(words)).status());
  return strays;
}

// The thread that asks Slurm what concerns no lease.
void SlurmExecutor::Watch() {
  while (true) {
    const absl::StatusOr<size_t> strays = CancelStrays();
    bool drained = false;
    {
      const MutexLock lock(mutex_);
      drained = !health_.Drained().empty();
    }
    absl::StatusOr<std::set<std::string>> usable = std::set<std::string>();
    if (drained) usable = UsableNodes();
    const MutexLock lock(mutex_);
    if (stopping_) return;
    if (strays.ok()) {
      unseen_.clear();
    } else if (!unseen_.empty()) {
      const std::string why = absl::StrCat("the cluster does not answer: ", strays.status().message());
      if (unseen_ != why) spdlog::error("{}", why);
      unseen_ = why;
    }
    if (usable.ok()) usable_ = *std::move(usable);
    const bool calm = strays.ok() && *strays == 0 && !drained;
    news_.WaitUntil(mutex_, std::chrono::steady_clock::now() + (calm ? kWatchEvery : kWatchAgain));
    if (stopping_) return;
  }
}

std::string SlurmExecutor::CannotStart() const {
  if (!options_.held_back.empty()) return options_.held_back;
  const MutexLock lock(mutex_);
  if (!unseen_.empty()) return unseen_;
  const std::map<std::string, std::string> drained = health_.Drained();
  if (!usable_.empty() && std::all_of(usable_.begin(), usable_.end(), [&](const std::string& node) {
        return drained.contains(node);
      })) {
    const auto& [node, why] = *drained.begin();
    return absl::StrCat("all nodes of the cluster are drained or down; ", node, ": ", why,
                        "; repair them, then \"myograde cluster admit NODE\"");
  }
  for (const auto& [comment, lease] : leases_) {
    if (lease != nullptr && !lease->trouble().empty()) {
      return absl::StrCat("the cluster takes no jobs: ", lease->trouble());
    }
  }
  return "";
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
  RETURN_IF_ERROR(CheckNodeName(node));
  const MutexLock lock(mutex_);
  health_.Drain(node, why);
  news_.NotifyAll();
  return absl::OkStatus();
}

absl::Status SlurmExecutor::Admit(const std::string& node) {
  RETURN_IF_ERROR(CheckNodeName(node));
  const MutexLock lock(mutex_);
  health_.Admit(node);
  return absl::OkStatus();
}

std::vector<DrainedNode> SlurmExecutor::TakeDrained() {
  const MutexLock lock(mutex_);
  return health_.TakeDrained();
}

}  // namespace myograde::server
