#include "server/runner/lease_runner.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <new>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/outcome.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kBeatPeriod = absl::Milliseconds(700);
constexpr absl::Duration kIdleTurn = absl::Milliseconds(200);
constexpr absl::Duration kPrintDeadline = absl::Seconds(30);
// Nothing signals the end of a process here, so poll for it.
constexpr absl::Duration kExitPollInterval = absl::Milliseconds(5);
constexpr absl::Duration kSimFarewell = absl::Seconds(5);
// Of the simulator's last words, which a full pipe holds.
constexpr int kMostReads = 64;

absl::Status Errno(const char* what) {
  return absl::InternalError(absl::StrCat(what, ": ", std::strerror(errno)));
}

absl::StatusOr<std::pair<Fd, Fd>> SocketPair() {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) {
    return Errno("can't make a socket pair");
  }
  return std::pair(Fd(ends[0]), Fd(ends[1]));
}

}  // namespace

LeaseRunner::LeaseRunner(const LeaseContext& context, int records, int stop, int signals)
    : context_(context),
      records_(records),
      stop_(stop),
      signals_(signals),
      sim_errors_(context.order.track.budgets.output_bytes),
      stdout_(context.order.track.budgets.output_bytes),
      stderr_(context.order.track.budgets.output_bytes),
      start_(SystemClock().Monotonic()),
      last_heard_(start_),
      last_printed_(start_),
      next_sample_(start_),
      last_idle_sample_(start_) {
  progress_.episode = context.order.episodes.front().index;
}

LeaseRunner::~LeaseRunner() {
  if (cpu_page_ != nullptr) munmap(cpu_page_, sizeof(CpuPage));
}

bool LeaseRunner::Run() {
  const absl::Status status = Play();
  // Prepared, but the simulator failed before asking for it.
  if (prepared_ != nullptr) EndRun(std::move(prepared_));
  (void)Heartbeat();
  EndPolicy();
  (void)Heartbeat();
  EndSim();
  LeaseEndRecord end;
  end.ok = status.ok();
  end.detail = PrintableUtf8(std::string(status.message()));
  end.stdout_tail = stdout_.tail();
  end.stderr_tail = stderr_.tail();
  end.stdout_truncated = stdout_.truncated();
  end.stderr_truncated = stderr_.truncated();
  end.policy_cpu_s = static_cast<double>(finished_cpu_ns_) * 1e-9;
  end.simulator_cpu_s = static_cast<double>(std::max<int64_t>(sim_cpu_ns_, 0)) * 1e-9;
  end.wall_s = absl::ToDoubleSeconds(SystemClock().Monotonic() - start_);
  end.peak_memory_bytes = peak_memory_;
  const bool recorded = Print(LeaseRecordToLine(end)).ok() && status.ok();
  WaitForLeftovers();
  return recorded;
}

absl::Status LeaseRunner::Play() {
  RETURN_IF_ERROR(StartSim());
  if (context_.order.replay.empty()) {
    RETURN_IF_ERROR(PreparePolicy());
  }
  while (!done_) {
    RETURN_IF_ERROR(RunOnce());
  }
  AwaitPolicyExit();
  AwaitSimExit();
  return absl::OkStatus();
}

absl::Status LeaseRunner::StartSim() {
  ASSIGN_OR_RETURN(auto channel, SocketPair());
  ASSIGN_OR_RETURN(const Fd order,
                   MakeMemoryFile("myograde-order", LeaseOrderToJson(context_.order).dump()));
  ASSIGN_OR_RETURN(Fd page,
                   MakeMemoryFile("myograde-cpu", std::string(sizeof(CpuPage), '\0')));
  void* memory =
      mmap(nullptr, sizeof(CpuPage), PROT_READ | PROT_WRITE, MAP_SHARED, page.get(), 0);
  if (memory == MAP_FAILED) return Errno("can't share a page with the simulator");
  cpu_page_ = new (memory) CpuPage{};
  ASSIGN_OR_RETURN(Pipe errors, MakeOutputPipe());
  sim_stderr_ = std::move(errors.read);
  Fd nothing(open("/dev/null", O_RDWR | O_CLOEXEC));
  const SandboxSpec spec = MakeSimSandbox(context_.order, context_.config.sim, context_.bin_dir,
                                          context_.stage, context_.etc);
  ASSIGN_OR_RETURN(Fd filter, MakeSeccompFilter(context_.config.policy));
  GroupLimits limits = SimGroupLimits(context_.config.sim);
  limits.background = context_.order.background;
  sim_group_ = ControlGroup::Create(GroupName("sim"), limits);
  std::vector<SandboxFd> fds = {{nothing.get(), 0},         {nothing.get(), 1},
                                {errors.write.get(), 2},    {channel.second.get(), kSimChannelFd},
                                {order.get(), kSimOrderFd}, {page.get(), kSimCpuPageFd}};
  if (context_.logs != nullptr) fds.push_back({context_.logs->writer(), kSimLogFd});
  if (context_.trajectory != nullptr) {
    fds.push_back({context_.trajectory->memory(), kSimTrajectoryFd});
  }
  absl::StatusOr<std::unique_ptr<Sandbox>> sim =
      Sandbox::Start(spec, fds, sim_group_->join_fds(), filter);
  if (context_.logs != nullptr) context_.logs->CloseWriter();
  if (!sim.ok()) return sim.status();
  sim_ = *std::move(sim);
  if (!sim_group_->controllers().cpu_account) {
    sim_tree_.emplace(sim_->pid(), absl::Seconds(context_.config.policy.cpu_refresh_s));
  }
  channel_ = std::move(channel.first);
  cpu_page_fd_ = std::move(page);
  last_heard_ = SystemClock().Monotonic();
  return absl::OkStatus();
}

absl::Status LeaseRunner::RunOnce() {
  // Once the tail is full, the rest of a flood is read only on each refresh: the policy then blocks
  // on its pipe instead of on a busy processor.
  const bool heard = policy_ != nullptr && !stdout_.truncated() && !stderr_.truncated();
  const int policy_out = heard ? policy_->stdout_fd() : -1;
  const int policy_err = heard ? policy_->stderr_fd() : -1;
  pollfd entries[] = {{channel_.get(), POLLIN, 0},     {stop_, POLLIN, 0},
                      {signals_, POLLIN, 0},           {policy_out, POLLIN, 0},
                      {policy_err, POLLIN, 0},         {sim_stderr_.get(), POLLIN, 0},
                      {context_.logs != nullptr ? context_.logs->reader() : -1, POLLIN, 0}};
  const absl::Duration until_sample = next_sample_ - SystemClock().Monotonic();
  const absl::Duration turn =
      policy_ != nullptr ? std::clamp(until_sample, absl::ZeroDuration(), kIdleTurn) : kIdleTurn;
  poll(entries, std::size(entries),
       static_cast<int>(absl::ToInt64Milliseconds(absl::Ceil(turn, absl::Milliseconds(1)))));
  if (entries[1].revents != 0 || entries[2].revents != 0) {
    return absl::CancelledError("the lease was ended by its caller");
  }
  if (entries[5].revents != 0) DrainInto(sim_stderr_, 1, sim_errors_);
  if (policy_ != nullptr) {
    const bool due = SystemClock().Monotonic() >= next_sample_;
    if (due || entries[3].revents != 0 || entries[4].revents != 0) policy_->DrainOutput();
    if (due) SamplePolicy();
  }
  // After any waiting message, which may say where the log ends.
  if (entries[6].revents != 0 && entries[0].revents == 0) {
    RETURN_IF_ERROR(context_.logs->Drain());
  }
  if (entries[0].revents != 0) {
    if (absl::Status status = HandleSimMessage(); !status.ok() || done_) return status;
  }
  if (policy_requested_at_.has_value()) {
    RETURN_IF_ERROR(SendPolicyWhenAlone());
  }
  RETURN_IF_ERROR(CheckDeadlines());
  return Heartbeat();
}

absl::Status LeaseRunner::HandleSimMessage() {
  absl::StatusOr<SimMessage> message = ReceiveSimMessage(channel_.get(), absl::ZeroDuration());
  if (absl::IsUnavailable(message.status())) return SimEnded();
  if (absl::IsDeadlineExceeded(message.status())) return absl::OkStatus();
  if (!message.ok()) {
    return absl::InternalError(
        absl::StrCat("the simulator sent a malformed message: ", message.status().message()));
  }
  last_heard_ = SystemClock().Monotonic();
  const std::string type = message->json["type"].get<std::string>();
  if (type == "need_policy") return SendPolicy();
  if (type == "policy_fault") return JudgeFault(message->json);
  if (type == "need_log") return SendLog();
  if (type == "need_cpu") return ReportCpu();
  if (type == "trajectory") return KeepTrajectory(message->json);
  if (type == "done") {
    done_ = true;
    if (next_episode_ == context_.order.episodes.size()) return absl::OkStatus();
    return absl::InternalError(absl::StrCat("the simulator says done after ", next_episode_,
                                            " of ", context_.order.episodes.size(), " episodes"));
  }
  return HandleRecord(message->json);
}

absl::Status LeaseRunner::HandleRecord(const nlohmann::json& json) {
  absl::StatusOr<LeaseRecord> record = LeaseRecordFromJson(json);
  if (!record.ok()) {
    return absl::InternalError(
        absl::StrCat("the simulator sent a broken record: ", record.status().message()));
  }
  if (auto* progress = std::get_if<ProgressRecord>(&*record)) {
    progress_ = *progress;
    return Print(CanonicalJson(json));
  }
  const auto* facts = std::get_if<EpisodeFacts>(&*record);
  const auto* replay = std::get_if<ReplayRecord>(&*record);
  const std::vector<EpisodeOrder>& episodes = context_.order.episodes;
  const bool replaying = !context_.order.replay.empty();
  const EpisodeOrder* next = next_episode_ < episodes.size() ? &episodes[next_episode_] : nullptr;
  const bool fits = next != nullptr &&
                    (replaying ? replay != nullptr && replay->episode == next->index
                               : facts != nullptr && facts->index == next->index &&
                                     facts->seed == next->seed);
  if (!fits) {
    return absl::InternalError("the simulator recorded an episode that was not its next");
  }
  if (facts != nullptr && context_.logs != nullptr) {
    RETURN_IF_ERROR(context_.logs->Finish(facts->log));
  }
  ++next_episode_;
  if (policy_ != nullptr) policy_->EpisodeOver();
  return Print(CanonicalJson(json));
}

absl::Status LeaseRunner::SendLog() {
  if (next_episode_ >= context_.replays.size()) {
    return absl::InternalError("the simulator wants a log that the order does not name");
  }
  return SendSimMessage(channel_.get(), {{"type", "log"}}, context_.replays[next_episode_].get());
}

absl::Status LeaseRunner::KeepTrajectory(const nlohmann::json& json) {
  const auto bytes = json.find("bytes");
  if (context_.trajectory == nullptr || bytes == json.end() || !bytes->is_number_integer()) {
    return absl::InternalError("the simulator reported a trajectory that was not requested");
  }
  return context_.trajectory->Keep(bytes->get<int64_t>());
}

absl::Status LeaseRunner::PreparePolicy() {
  if (runs_ > context_.order.track.budgets.restarts) {
    return absl::InternalError("the simulator wants more policies than the budget allows");
  }
  ASSIGN_OR_RETURN(auto pair, SocketPair());
  ASSIGN_OR_RETURN(prepared_,
                   PolicyRun::Prepare(context_, runs_++, std::move(pair.second), stdout_, stderr_));
  prepared_channel_ = std::move(pair.first);
  return absl::OkStatus();
}

absl::Status LeaseRunner::SendPolicy() {
  EndPolicy();
  if (!Alone()) {
    policy_requested_at_ = SystemClock().Monotonic();
    return absl::OkStatus();
  }
  if (prepared_ == nullptr) {
    RETURN_IF_ERROR(PreparePolicy());
  }
  policy_ = std::move(prepared_);
  policy_->Begin();
  const Fd channel = std::move(prepared_channel_);
  return SendSimMessage(channel_.get(), {{"type", "policy"}}, channel.get());
}

absl::Status LeaseRunner::JudgeFault(const nlohmann::json& json) {
  nlohmann::json evidence = json;
  evidence.erase("type");
  absl::StatusOr<FaultEvidence> seen = FaultEvidenceFromJson(evidence);
  if (!seen.ok()) {
    return absl::InternalError(
        absl::StrCat("the simulator sent broken evidence: ", seen.status().message()));
  }
  if (policy_ == nullptr) {
    return absl::InternalError("the simulator blames a policy that it has not");
  }
  const FaultEvidence ruled = policy_->Rule(*std::move(seen));
  last_ruling_ = ruled;
  EndPolicy();
  if (FaultOf(ruled.outcome) == Fault::kGrader) return absl::InternalError(ruled.detail);
  nlohmann::json answer = FaultEvidenceToJson(ruled);
  answer["type"] = "ruling";
  return SendSimMessage(channel_.get(), answer);
}

// After the last episode the bridge has asked the policy to exit; keep reading what it prints.
void LeaseRunner::AwaitPolicyExit() {
  if (policy_ == nullptr) return;
  const absl::Duration deadline =
      SystemClock().Monotonic() + absl::Seconds(context_.config.policy.farewell_s);
  while (!policy_->Ended() && SystemClock().Monotonic() < deadline) {
    pollfd entries[] = {{stop_, POLLIN, 0},
                        {signals_, POLLIN, 0},
                        {policy_->stdout_fd(), POLLIN, 0},
                        {policy_->stderr_fd(), POLLIN, 0}};
    poll(entries, std::size(entries),
         static_cast<int>(absl::ToInt64Milliseconds(kExitPollInterval)));
    if (entries[0].revents != 0 || entries[1].revents != 0) return;
    policy_->DrainOutput();
  }
}

void LeaseRunner::EndPolicy() {
  if (policy_ == nullptr) return;
  policy_->End();
  policy_->DrainOutput();
  peak_memory_ = std::max(peak_memory_, policy_->peak_memory_bytes());
  finished_cpu_ns_ += policy_->CpuNs();
  EndRun(std::move(policy_));
  RefreshCpu();
}

void LeaseRunner::EndSim() {
  if (sim_ == nullptr) return;
  const Deadline deadline(absl::Seconds(context_.config.policy.kill_s));
  if (sim_tree_.has_value()) sim_cpu_ns_ = sim_tree_->CpuNs(/*by_chance=*/false);
  const bool dead = sim_->Kill(deadline.left());
  if (!sim_group_->KillAll(deadline.left()) || !dead) {
    leftovers_.push_back([this] { return sim_->Gone() && sim_group_->Members().empty(); });
  }
  if (!sim_tree_.has_value()) sim_cpu_ns_ = sim_group_->cpu_ns();
}

void LeaseRunner::RefreshCpu(bool by_chance) {
  const int64_t now =
      finished_cpu_ns_ + (policy_ != nullptr ? policy_->CpuNs(by_chance) : 0);
  cpu_page_->cpu_ns.store(static_cast<uint64_t>(now), std::memory_order_relaxed);
  cpu_page_->updates.fetch_add(1, std::memory_order_relaxed);
}

absl::Status LeaseRunner::ReportCpu() {
  RefreshCpu();
  return SendSimMessage(channel_.get(), {{"type", "cpu"}});
}

void LeaseRunner::AwaitSimExit() {
  // A process takes its times along when it is reaped; a control group keeps them.
  if (sim_tree_.has_value()) sim_tree_->CpuNs(/*by_chance=*/false);
  sim_->Wait(kSimFarewell);
}

absl::Status LeaseRunner::SimEnded() {
  AwaitSimExit();
  DrainInto(sim_stderr_, kMostReads, sim_errors_);
  const SandboxEnd end = sim_->end();
  std::string words = sim_errors_.tail();
  while (!words.empty() && words.back() == '\n') words.pop_back();
  if (words.empty()) words = "it printed no reason";
  if (sim_group_->oom_kills() > 0) {
    return absl::InternalError(absl::StrCat(
        "the simulator used all of its ", context_.config.sim.memory_bytes,
        " bytes of memory (memory_bytes of sandbox/sim.json) and was stopped: ", words));
  }
  std::string how = absl::StrCat("exit status ", end.exit_code);
  if (end.exit_code > 128) how = absl::StrCat("signal ", end.exit_code - 128);
  if (!end.started) {
    return absl::InternalError(absl::StrCat("the simulator's sandbox could not be built (", how,
                                            "): ", words));
  }
  if (end.exit_code == 128 + SIGSYS) {
    how += " (a system call that allowed_system_calls of sandbox/sim.json does not hold)";
  }
  return absl::InternalError(
      absl::StrCat("the simulator ended with ", how, " before the lease was done: ", words));
}

absl::Status LeaseRunner::CheckDeadlines() const {
  const SimSandboxConfig& config = context_.config.sim;
  const absl::Duration now = SystemClock().Monotonic();
  if (now - last_heard_ > absl::Seconds(config.silence_s)) {
    return absl::DeadlineExceededError(
        absl::StrCat("the simulator said nothing for ", config.silence_s, " s (silence_s)"));
  }
  const double most = context_.order.track.budgets.lease_wall_s + config.lease_slack_s;
  if (now - start_ > absl::Seconds(most)) {
    return absl::DeadlineExceededError(absl::StrCat("the lease was not over after ", most, " s"));
  }
  return absl::OkStatus();
}

absl::Status LeaseRunner::Heartbeat() {
  if (SystemClock().Monotonic() - last_printed_ < kBeatPeriod) return absl::OkStatus();
  return Print(LeaseRecordToLine(progress_));
}

absl::Status LeaseRunner::Print(std::string line) {
  line += '\n';
  const Deadline deadline(kPrintDeadline);
  size_t written = 0;
  while (written < line.size()) {
    pollfd entry = {records_, POLLOUT, 0};
    poll(&entry, 1, 1000);
    const ssize_t n = write(records_, line.data() + written, line.size() - written);
    if (n > 0) {
      written += static_cast<size_t>(n);
    } else if (errno != EINTR && errno != EAGAIN) {
      return absl::CancelledError("nobody reads the lease's records any longer");
    }
    if (deadline.over()) return absl::CancelledError("the lease's records are not read");
  }
  last_printed_ = SystemClock().Monotonic();
  return absl::OkStatus();
}

}  // namespace myograde::server
