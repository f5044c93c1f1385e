// The executor's thread that talks to Slurm.
#include <algorithm>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>
#include <spdlog/spdlog.h>

#include "protocol/base/clock.h"
#include "server/base/counted.h"
#include "server/base/random_bytes.h"
#include "server/executor/slurm/batch_script.h"
#include "server/executor/slurm/slurm_executor.h"

namespace myograde::server {
namespace {

// With nothing on the cluster, its queue is looked at for strays and for whether it answers.
constexpr absl::Duration kIdle = absl::Seconds(10);
// After a queue that did not answer.
constexpr absl::Duration kAfterTrouble = absl::Seconds(5);
// Between two looks at the cluster's nodes.
constexpr absl::Duration kNodesEvery = absl::Seconds(10);
// The share of the time that a slow queue is asked in, as one part in so many.
constexpr int kShare = 5;
constexpr size_t kMostCancels = 200;  // by one command
constexpr size_t kCommentBytes = 8;
constexpr absl::Duration kFarewell = absl::Seconds(2);

}  // namespace

void SlurmExecutor::TalkToSlurm() {
  while (true) {
    std::vector<SlurmJob> strays;
    bool look = false;
    {
      const MutexLock lock(mutex_);
      while (!stopping_ && !AnyDue()) {
        const absl::Duration until = std::min(next_look_, emptied_ ? jobs_.next_at() : next_look_);
        const auto wait = absl::ToChronoMilliseconds(
            std::clamp(until - Now(), absl::Milliseconds(1), absl::Seconds(10)));
        talk_.WaitUntil(mutex_, std::chrono::steady_clock::now() + wait);
      }
      if (stopping_) break;
      strays = jobs_.TakeStrays();
      look = Now() >= next_look_;
    }
    if (!strays.empty()) CancelStrays(std::move(strays));
    if (SubmitNext()) continue;
    if (look) {
      LookAtQueue();
      LookAtNodes();
    }
  }
  {
    const MutexLock lock(mutex_);
    if (!emptied_) return;  // what is there is another daemon's
  }
  const SlurmCommands farewell(options_.config, job_name_, [] { return false; }, kFarewell);
  if (absl::Status status = farewell.CancelAll(); !status.ok()) {
    spdlog::warn("jobs may be left on the cluster, and end by themselves: {}",
                 std::string(status.message()));
  }
}

bool SlurmExecutor::AnyDue() const {
  return Now() >= next_look_ || jobs_.has_strays() || Now() >= jobs_.next_at();
}

BatchOrder SlurmExecutor::MakeBatch(const JobTable::Batch& batch, const std::string& comment) {
  const SlurmConfig& config = options_.config;
  const bool shared = !config.shared_dir.empty();
  const auto or_else = [](const std::string& own, const std::string& usual) {
    return own.empty() ? usual : own;
  };
  const ScriptPlaces places = {
      .program = or_else(config.bin_dir, options_.bin_dir) + "/myograde-node",
      .spool = shared ? spool_path_ : "",
      .url = config.url,
      .ca_file = config.ca_file,
      .cache_dir = or_else(config.cache_dir, options_.cache_dir),
      .node_dir = config.node_dir,
      .configs_dir = options_.configs_dir};
  std::vector<ScriptLease> leases;
  for (const std::string& name : batch.names) {
    const auto it = attempts_.find(name);
    leases.push_back({name, it == attempts_.end() ? "" : it->second->token});
  }
  return {.batch = comment,
          .script = BatchScript(places, leases),
          .tasks = std::ssize(leases),
          .needs = batch.needs,
          .exclude = health_.Drained()};
}

// True if there was something to submit.
bool SlurmExecutor::SubmitNext() {
  const absl::StatusOr<std::string> random = RandomBytes(kCommentBytes);
  if (!random.ok()) return false;
  const std::string comment =
      HexOf({reinterpret_cast<const uint8_t*>(random->data()), random->size()});
  std::optional<JobTable::Batch> batch;
  BatchOrder order;
  {
    const MutexLock lock(mutex_);
    batch = jobs_.Next(Now());
    if (!batch.has_value()) return false;
    order = MakeBatch(*batch, comment);
  }
  const absl::StatusOr<int64_t> job = commands_.Submit(order);
  const MutexLock lock(mutex_);
  if (job.ok()) {
    jobs_.Accepted(*batch, *job);
    spdlog::info("job {}: {}", *job, CountedBlocks(order.tasks));
  } else {
    const std::string why(job.status().message());
    spdlog::error("no job for {}: {}", CountedBlocks(order.tasks), why);
    if (absl::IsFailedPrecondition(job.status())) {
      jobs_.Refused(*batch, why, Now());
    } else {
      jobs_.Lost(*batch, comment, why, Now());
    }
  }
  // It may begin at once.
  next_look_ = std::min(next_look_, Now() + absl::Milliseconds(500));
  return true;
}

void SlurmExecutor::LookAtQueue() {
  const absl::Duration asked = Now();
  const absl::StatusOr<std::vector<SlurmJob>> queue = commands_.Queue();
  std::vector<SlurmJob> strays;
  {
    const MutexLock lock(mutex_);
    const absl::Duration took = Now() - asked;
    absl::Duration pause = std::max(options_.config.poll, kShare * took);
    if (queue.ok()) {
      if (!queue_trouble_.empty()) spdlog::info("the cluster answers");
      queue_trouble_.clear();
      strays = jobs_.See(*queue, asked);
      if (!emptied_) strays.clear();
      if (jobs_.empty() && strays.empty()) pause = std::max(pause, kIdle);
    } else {
      const std::string why(queue.status().message());
      if (queue_trouble_ != why) spdlog::error("the cluster does not answer: {}", why);
      queue_trouble_ = why;
      pause = std::max(pause, kAfterTrouble);
    }
    next_look_ = Now() + pause;
  }
  if (!strays.empty()) CancelStrays(std::move(strays));
  Wake();
}

// Only while a node is drained, as others need no command for it.
void SlurmExecutor::LookAtNodes() {
  {
    const MutexLock lock(mutex_);
    if (health_.Drained().empty()) usable_nodes_.reset();
    if (stopping_ || health_.Drained().empty() || Now() < next_nodes_) return;
  }
  absl::StatusOr<std::vector<std::string>> nodes = commands_.Nodes();
  const MutexLock lock(mutex_);
  next_nodes_ = Now() + kNodesEvery;
  if (nodes.ok()) usable_nodes_ = *std::move(nodes);
}

void SlurmExecutor::CancelStrays(std::vector<SlurmJob> strays) {
  for (size_t first = 0; first < strays.size(); first += kMostCancels) {
    const auto begin = strays.begin() + static_cast<std::ptrdiff_t>(first);
    const auto end = strays.begin() +
                     static_cast<std::ptrdiff_t>(std::min(first + kMostCancels, strays.size()));
    const absl::Status status = commands_.Cancel({begin, end});
    // The next look finds those that are left, and they are cancelled again.
    if (!status.ok()) spdlog::warn("jobs can't be cancelled: {}", std::string(status.message()));
  }
  const MutexLock lock(mutex_);
  next_look_ = std::min(next_look_, Now() + absl::Milliseconds(500));
}

}  // namespace myograde::server
