#include "server/proof/replay_run.h"

#include <poll.h>

#include <filesystem>
#include <optional>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "server/runner/lease_report.h"
#include "server/runner/runner_process.h"

namespace myograde::server {
namespace {

constexpr int kPollMilliseconds = 100;
constexpr absl::Duration kGrace = absl::Minutes(5);

// A block being played on a slot.
struct Running {
  size_t block = 0;
  std::unique_ptr<RunnerProcess> runner;
  LeaseReport report;
};

class Run {
 public:
  Run(const ReplayOrder& order, const ReplayHooks& hooks)
      : order_(order),
        hooks_(hooks),
        slots_(static_cast<size_t>(order.slots)),
        records_(order.blocks.size()) {
    for (const ReplayBlock& block : order.blocks) total_ += std::ssize(block.episodes);
  }

  absl::StatusOr<std::vector<ReplayRecord>> Play() {
    while (true) {
      if (hooks_.stopped()) return absl::CancelledError("the replay was interrupted");
      for (size_t slot = 0; slot < slots_.size() && next_ < order_.blocks.size(); ++slot) {
        if (slots_[slot].has_value()) continue;
        RETURN_IF_ERROR(Start(slot));
      }
      Wait();
      bool busy = false;
      for (std::optional<Running>& slot : slots_) {
        if (!slot.has_value()) continue;
        RETURN_IF_ERROR(Listen(slot));
        busy = busy || slot.has_value();
      }
      hooks_.progress(done_, total_);
      if (!busy && next_ == order_.blocks.size()) break;
    }
    std::vector<ReplayRecord> all;
    for (const std::vector<ReplayRecord>& block : records_) {
      all.insert(all.end(), block.begin(), block.end());
    }
    return all;
  }

 private:
  absl::Status Start(size_t slot) {
    const ReplayBlock& block = order_.blocks[next_];
    const std::string id = absl::StrCat("replay-", next_);
    const int64_t user = order_.uid_base < 0 ? -1 : order_.uid_base + static_cast<int64_t>(slot);
    LeaseOrder lease = MakeLeaseOrder(id, order_.track, block.episodes, {},
                                      {.slot = static_cast<int64_t>(slot),
                                       .uid = user,
                                       .work_dir = absl::StrCat(order_.work_dir, "/", id),
                                       .cache_dir = order_.cache_dir,
                                       .log_dir = ""});
    lease.replay = block.logs;
    lease.trajectory = block.trajectory;
    lease.background = order_.background;
    std::error_code error;
    if (!std::filesystem::create_directory(lease.work_dir, error)) {
      return absl::InternalError(
          absl::StrCat(lease.work_dir, ": can't be created: ", error.message()));
    }
    absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(lease);
    if (!runner.ok()) return absl::InternalError(runner.status().message());
    slots_[slot].emplace();
    slots_[slot]->block = next_++;
    slots_[slot]->runner = *std::move(runner);
    const absl::Duration now = SystemClock().Monotonic();
    slots_[slot]->report = LeaseReport(
        lease.episodes,
        {.deadline = now + absl::Seconds(order_.track.budgets.lease_wall_s) + kGrace}, now);
    return absl::OkStatus();
  }

  void Wait() const {
    std::vector<pollfd> fds;
    for (const std::optional<Running>& slot : slots_) {
      if (!slot.has_value()) continue;
      for (const int fd : {slot->runner->stdout_fd(), slot->runner->stderr_fd()}) {
        if (fd >= 0) fds.push_back({fd, POLLIN, 0});
      }
    }
    // An interrupt only ends the wait early; the loop checks again.
    ::poll(fds.data(), fds.size(), kPollMilliseconds);
  }

  absl::Status Listen(std::optional<Running>& slot) {
    const bool finished = slot->runner->finished();
    absl::StatusOr<std::vector<LeaseRecord>> records = slot->runner->Read();
    if (!records.ok()) return absl::InternalError(records.status().message());
    const absl::Duration now = SystemClock().Monotonic();
    LeaseReport& report = slot->report;
    const LeaseReport::News news = report.Take(*records, now);
    for (const ReplayRecord& replay : news.replays) records_[slot->block].push_back(replay);
    done_ += std::ssize(news.replays);
    report.Tick(now);
    if (report.lingers(now)) slot->runner->KillNow();
    if (finished) report.Conclude(slot->runner->wait_status(), slot->runner->stderr_tail());
    if (report.faulty()) {
      return absl::InternalError(
          absl::StrCat("the replay failed because of a fault of the grader: ", report.fault()));
    }
    if (!finished) return absl::OkStatus();
    slot.reset();
    return absl::OkStatus();
  }

  const ReplayOrder& order_;
  const ReplayHooks& hooks_;
  std::vector<std::optional<Running>> slots_;
  std::vector<std::vector<ReplayRecord>> records_;  // per block
  size_t next_ = 0;
  int64_t done_ = 0;
  int64_t total_ = 0;
};

}  // namespace

bool CarriesOver(const TrackConfig& track) { return track.rules.value("one_environment", false); }

absl::StatusOr<std::vector<ReplayRecord>> RunReplay(const ReplayOrder& order,
                                                    const ReplayHooks& hooks) {
  return Run(order, hooks).Play();
}

}  // namespace myograde::server
