// The loop around the core. Requests from other threads: engine_requests.cc.
#include "server/engine/engine.h"

#include <poll.h>

#include <algorithm>

namespace myograde::server {
namespace {

constexpr size_t kMaxCommands = 1024;
// After its grace a stopping runner is killed, and dead soon after.
constexpr absl::Duration kAfterGrace = absl::Milliseconds(250);

}  // namespace

Engine::Engine(EngineOptions options, Disk& disk, ReaderPool& readers, Executor& executor,
               const Clock& clock)
    : data_dir_(options.data_dir),
      cache_dir_(options.cache_dir),
      runtimes_(options.config.runtimes, options.config.runtimes_dir),
      readers_(readers),
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

}  // namespace myograde::server
