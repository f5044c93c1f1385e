#include "server/executor/node/play.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/time/clock.h>

#include "protocol/base/clock.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/output_tail.h"
#include "server/base/program_run.h"
#include "server/base/random_bytes.h"
#include "server/executor/node/energy.h"
#include "server/executor/node/node_artefacts.h"
#include "server/executor/node/node_slot.h"
#include "server/executor/node/proof.h"
#include "server/runner/log_keeper.h"
#include "server/runner/runner_process.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kOrderPoll = absl::Milliseconds(300);
constexpr absl::Duration kProofTime = absl::Minutes(15);
constexpr int kTurnMs = 500;
// Beyond the order's wall time, in which the runner ends by itself.
constexpr absl::Duration kWallGrace = absl::Seconds(30);
// Waiting for the relay beyond the time after which it gives up by itself.
constexpr absl::Duration kRelayGrace = absl::Minutes(1);

// Ends the process with SIGALRM if a disk or a network hangs, as nothing else can be done then.
class HangGuard {
 public:
  explicit HangGuard(absl::Duration most) {
    alarm(static_cast<unsigned>(absl::ToInt64Seconds(most)));
  }
  ~HangGuard() { alarm(0); }
  HangGuard(const HangGuard&) = delete;
  HangGuard& operator=(const HangGuard&) = delete;
};

constexpr absl::Duration kDiskTime = absl::Minutes(2);
constexpr absl::Duration kFetchTime = absl::Minutes(30);

// Within what a form takes, whatever it holds.
std::string Short(const std::string& text) { return PrintableUtf8(text.substr(0, 4096)); }

void Say(absl::string_view text) {
  std::fprintf(stderr, "myograde-node: %.*s\n", static_cast<int>(text.size()), text.data());
}

const char* Environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// "1234_5" of an array's task, "1234" of a job, "" outside Slurm.
std::string JobName() {
  const std::string array = Environment("SLURM_ARRAY_JOB_ID");
  const std::string task = Environment("SLURM_ARRAY_TASK_ID");
  std::string job = !array.empty() && !task.empty() ? array + "_" + task
                                                    : std::string(Environment("SLURM_JOB_ID"));
  if (job.size() > 64 || job.find_first_not_of("0123456789_") != std::string::npos) job.clear();
  return job;
}

int64_t RestartCount() {
  const int64_t count = std::atol(Environment("SLURM_RESTART_COUNT"));
  return std::clamp<int64_t>(count, 0, INT32_MAX);
}

double CpuOfChildren() {
  rusage usage;
  if (getrusage(RUSAGE_CHILDREN, &usage) != 0) return 0;
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6;
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

class Play {
 public:
  Play(LeaseChannel& channel, const PlayOptions& options)
      : channel_(channel), options_(options), node_(NodeName()) {}

  int Run() {
    if (const std::optional<int> status = Begin()) return *status;
    if (std::string why = Prepare(); !why.empty()) return Refuse(why);
    const int status = PlayIt();
    slot_->CleanUp();
    return status;
  }

 private:
  // Takes the order and claims it; an exit status if there is nothing to play.
  std::optional<int> Begin();
  absl::StatusOr<NodeOrder> AwaitOrder();
  absl::Status Claim();
  // Makes everything ready; why the node can't play it, or "".
  std::string Prepare();
  absl::StatusOr<NodeProof> Proof();
  absl::Status PutProof(const NodeProof& proof);
  absl::Status CheckRuntimes() const;
  absl::Status PlaceArtefact();
  // Says why it was not played, and nothing else.
  int Refuse(const std::string& why);
  int PlayIt();
  void Attend(RunnerProcess& runner, Relay& relay);
  void TakeRecords(RunnerProcess& runner, Relay& relay);
  NodeEnd EndOf(const RunnerProcess& runner);
  int SayGoodbye(Relay& relay, const NodeEnd& end);
  // Whether the host wants the lease to end; stays true.
  bool Stopped();

  // As long as it may pass, tries a call of the channel again, for `most`.
  template <typename Call>
  absl::Status Insist(absl::Duration most, const Call& call);

  LeaseChannel& channel_;
  const PlayOptions& options_;
  const std::string node_;
  NodeOrder order_;
  std::optional<NodeSlot> slot_;
  std::optional<HeldArtefact> artefact_;
  bool stopped_ = false;
  bool last_words_ = false;  // are on their way, whatever the host wants
  std::string why_;          // the lease is to end though nobody is to blame
  std::string fault_;        // what the runner printed that is no record
  double policy_cpu_s_ = 0;  // of the last record
};

bool Play::Stopped() {
  signalfd_siginfo info;
  while (!stopped_ && options_.stop >= 0) {
    const ssize_t n = read(options_.stop, &info, sizeof(info));
    if (n != static_cast<ssize_t>(sizeof(info))) break;
    stopped_ = true;
    why_ = absl::StrCat("the node was told to end it (signal ", info.ssi_signo,
                        "): its job was preempted, cancelled or at its time limit");
  }
  return stopped_;
}

template <typename Call>
absl::Status Play::Insist(absl::Duration most, const Call& call) {
  const Deadline deadline(most);
  absl::Duration delay = options_.relay.first_delay;
  for (;;) {
    absl::Status status;
    {
      const HangGuard guard(kDiskTime);
      status = call();
    }
    if (!ChannelMayRecover(status) || deadline.over()) return status;
    // In pieces, to hear of the end in time.
    for (const Deadline nap(delay); !nap.over(); absl::SleepFor(absl::Milliseconds(50))) {
      if (!last_words_ && Stopped()) return absl::CancelledError(why_);
    }
    delay = std::min(2 * delay, options_.relay.longest_delay);
  }
}

absl::StatusOr<NodeOrder> Play::AwaitOrder() {
  const Deadline deadline(options_.order_deadline);
  for (;;) {
    const HangGuard guard(kDiskTime);
    absl::StatusOr<NodeOrder> order = channel_.Order();
    // On a network's disk a new folder may take a while to be seen.
    const bool may_come = absl::IsNotFound(order.status()) || ChannelMayRecover(order.status());
    if (!may_come || deadline.over()) return order;
    if (Stopped()) return absl::CancelledError(why_);
    absl::SleepFor(kOrderPoll);
  }
}

absl::Status Play::Claim() {
  ASSIGN_OR_RETURN(const std::string random, RandomBytes(8));
  const NodeClaim claim = {
      node_, JobName(), RestartCount(),
      HexOf({reinterpret_cast<const uint8_t*>(random.data()), random.size()})};
  return Insist(options_.order_deadline, [&] { return channel_.PutClaim(claim); });
}

std::optional<int> Play::Begin() {
  absl::StatusOr<NodeOrder> order = AwaitOrder();
  if (!order.ok()) {
    Say(absl::StrCat("there is no order to play: ", order.status().message()));
    return ExitStatusOf(order.status());
  }
  if (order->name != options_.lease) {
    Say(absl::StrCat("the order is for lease ", order->name, ", not ", options_.lease));
    return kNodeTrouble;
  }
  order_ = *std::move(order);
  const absl::Status claimed = Claim();
  if (claimed.ok()) return std::nullopt;
  Say(claimed.message());
  return absl::IsAlreadyExists(claimed) ? kNodeSecond : kNodeTrouble;
}

absl::StatusOr<NodeProof> Play::Proof() {
  const bool again = std::find(order_.prove_again.begin(), order_.prove_again.end(), node_) !=
                     order_.prove_again.end();
  // A process of its own: the doctor wants a single thread, and this one listens for the end.
  std::vector<std::string> words = {"--prove",
                                    "--cache",     options_.cache_dir,
                                    "--configs",   options_.config_dir,
                                    "--node-dir",  options_.node_dir,
                                    "--adapter",   order_.order.adapter,
                                    "--uid-base",  absl::StrCat(order_.uid_base)};
  if (again) words.push_back("--again");
  ASSIGN_OR_RETURN(const ProgramEnd end, RunProgram({.program = "myograde-node",
                                                     .words = words,
                                                     .most_output = kMostFormBytes,
                                                     .deadline = kProofTime,
                                                     .nice = 0},
                                                    [this] { return Stopped(); }));
  if (end.exit_status != 0) {
    return absl::InternalError(absl::StrCat("the node's proof ", end.HowItEnded(), ": ",
                                            end.LastError()));
  }
  return NodeProofFromText(end.output, "the node's proof");
}

absl::Status Play::PutProof(const NodeProof& proof) {
  return Insist(options_.relay.cut_after, [&] { return channel_.PutProof(proof); });
}

absl::Status Play::CheckRuntimes() const {
  for (const NodeRuntime& wanted : order_.runtimes) {
    if (wanted.digest.empty()) {
      std::error_code error;
      if (std::filesystem::is_directory(wanted.path, error)) continue;
      return absl::NotFoundError(absl::StrCat("the runtime ", wanted.name, " is not at ",
                                              wanted.path, " on this node; copy it there"));
    }
    const absl::StatusOr<Runtime> runtime = ReadRuntime(wanted.path);
    if (!runtime.ok()) {
      return absl::NotFoundError(absl::StrCat("the runtime ", wanted.name, " is not at ",
                                              wanted.path, " on this node: ",
                                              runtime.status().message()));
    }
    if (runtime->digest != wanted.digest) {
      return absl::FailedPreconditionError(absl::StrCat(
          "the runtime ", wanted.name, " at ", wanted.path, " on this node has digest ",
          runtime->digest, ", and the lease needs ", wanted.digest, "; copy the daemon's there"));
    }
  }
  return absl::OkStatus();
}

absl::Status Play::PlaceArtefact() {
  if (!order_.artefact.has_value()) {
    // A self-test brings no files, and the sandbox shows some folder.
    if (!order_.order.artefact_dir.empty()) return absl::OkStatus();
    order_.order.artefact_dir = slot_->work_dir() + "/empty";
    std::error_code error;
    std::filesystem::create_directory(order_.order.artefact_dir, error);
    return absl::OkStatus();
  }
  const HangGuard guard(kFetchTime);
  const NodeArtefacts artefacts(options_.node_dir);
  absl::StatusOr<HeldArtefact> held =
      artefacts.Hold(*order_.artefact, [this](const NodeArtefact& artefact, int file) {
        return channel_.FetchArtefact(artefact, file);
      });
  if (!held.ok()) return held.status();
  artefact_.emplace(*std::move(held));
  order_.order.artefact_dir = artefact_->folder();
  return absl::OkStatus();
}

std::string Play::Prepare() {
  const auto why = [this](std::string_view what, const absl::Status& status) {
    if (stopped_) return why_;
    return absl::StrCat(absl::string_view(what.data(), what.size()), ": ", status.message());
  };
  const absl::StatusOr<NodeProof> proof = Proof();
  if (!proof.ok()) return why("the node can't prove itself", proof.status());
  if (absl::Status status = PutProof(*proof); !status.ok()) return why("no proof", status);
  if (std::string unequal = WhyNotEqual(*proof, order_.grader); !unequal.empty()) return unequal;
  if (absl::Status status = CheckRuntimes(); !status.ok()) return std::string(status.message());
  absl::StatusOr<NodeSlot> slot = NodeSlot::Take(options_.node_dir, order_.uid_base);
  if (!slot.ok()) return std::string(slot.status().message());
  slot_.emplace(*std::move(slot));
  LeaseOrder& lease = order_.order;
  if (absl::Status status = slot_->Prepare(lease); !status.ok()) {
    return why("the node has no place to work", status);
  }
  lease.cache_dir = options_.cache_dir;
  lease.log_dir = order_.logs ? slot_->work_dir() + "/logs" : "";
  if (absl::Status status = PlaceArtefact(); !status.ok()) {
    return why("the submission did not reach the node", status);
  }
  return Stopped() ? why_ : "";
}

int Play::Refuse(const std::string& why) {
  Say(why);
  NodeEnd end;
  end.records_sha256 = Sha256Hex("");
  end.why = Short(why);
  const absl::Duration most = stopped_ ? options_.farewell : options_.relay.cut_after;
  last_words_ = true;
  const absl::Status status = Insist(most, [&] { return channel_.PutEnd(end); });
  if (slot_.has_value()) slot_->CleanUp();
  if (status.ok() || absl::IsCancelled(status)) return kNodeDone;
  Say(status.message());
  return kNodeTrouble;
}

void Play::TakeRecords(RunnerProcess& runner, Relay& relay) {
  const absl::StatusOr<std::vector<LeaseRecord>> records = runner.Read();
  if (!records.ok()) {
    if (fault_.empty()) fault_ = std::string(records.status().message());
    runner.KillNow();
    return;
  }
  // What it says after it was asked to end is no news: the attempt is returned as a whole.
  if (!why_.empty()) return;
  for (const LeaseRecord& record : *records) {
    const auto* facts = std::get_if<EpisodeFacts>(&record);
    if (const auto* end = std::get_if<LeaseEndRecord>(&record)) policy_cpu_s_ = end->policy_cpu_s;
    if (facts != nullptr && !facts->log.sha256.empty() && order_.logs) {
      const std::string name = LogFileName(facts->log.sha256);
      const std::string path = order_.order.log_dir + "/" + name;
      Fd file(open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC));
      if (!file.valid()) {
        if (fault_.empty()) fault_ = absl::StrCat("the log ", name, " of an episode is missing");
        runner.KillNow();
        return;
      }
      // The open file is all that is needed.
      unlink(path.c_str());
      relay.AddLog(name, std::move(file));
    }
    relay.AddRecords(LeaseRecordToLine(record) + "\n");
  }
}

void Play::Attend(RunnerProcess& runner, Relay& relay) {
  const Deadline wall(order_.wall_s > 0 ? absl::Seconds(order_.wall_s) + kWallGrace
                                        : absl::InfiniteDuration());
  std::optional<Deadline> grace;  // of one that was asked to end
  while (!runner.finished()) {
    pollfd entries[] = {{runner.stdout_fd(), POLLIN, 0},
                        {runner.stderr_fd(), POLLIN, 0},
                        {grace.has_value() ? -1 : options_.stop, POLLIN, 0},
                        {grace.has_value() ? -1 : relay.wake_fd(), POLLIN, 0}};
    poll(entries, std::size(entries), grace.has_value() ? 50 : kTurnMs);
    TakeRecords(runner, relay);
    if (grace.has_value()) {
      if (grace->over()) runner.KillNow();
      continue;
    }
    bool ends = Stopped() || wall.over() || !fault_.empty();
    if (const absl::Status status = relay.status(); !status.ok() && why_.empty()) {
      why_ = std::string(status.message());
      ends = true;
    }
    if (!ends) continue;
    if (wall.over() && why_.empty() && fault_.empty()) {
      fault_ = absl::StrCat("the runner did not end in ", order_.wall_s, " s");
    }
    runner.AskToEnd();
    grace.emplace(Runner::kCleanUpGrace);
  }
}

NodeEnd Play::EndOf(const RunnerProcess& runner) {
  NodeEnd end;
  end.wait_status = runner.wait_status();
  end.stderr_tail = fault_.empty() ? runner.stderr_tail() : Short(fault_);
  end.cpu_s = std::max(CpuOfChildren(), policy_cpu_s_);
  end.energy_j = stopped_ ? std::nullopt : EnergyOfJob();
  end.why = Short(why_);
  return end;
}

int Play::SayGoodbye(Relay& relay, const NodeEnd& end) {
  bool at_once = !end.why.empty();
  NodeEnd last = end;
  if (at_once) {
    relay.EndNow(last);
  } else {
    relay.AddEnd(last);
  }
  Deadline deadline(at_once ? options_.farewell : options_.relay.cut_after + kRelayGrace);
  while (!relay.over() && !deadline.over()) {
    pollfd entries[] = {{relay.wake_fd(), POLLIN, 0}, {at_once ? -1 : options_.stop, POLLIN, 0}};
    poll(entries, std::size(entries), 100);
    // All was played, but not all has arrived: as long as the host waits, it may still.
    if (!at_once && Stopped()) {
      at_once = true;
      deadline = Deadline(options_.farewell);
    }
  }
  if (!relay.over()) {
    Say("the way back to the daemon hangs, and the lease's end was not told");
    slot_->CleanUp();
    std::_Exit(kNodeTrouble);
  }
  const absl::Status status = relay.status();
  if (status.ok() || absl::IsCancelled(status)) return kNodeDone;
  Say(status.message());
  return kNodeTrouble;
}

int Play::PlayIt() {
  absl::StatusOr<std::unique_ptr<RunnerProcess>> runner = RunnerProcess::Start(order_.order);
  if (!runner.ok()) return Refuse(std::string(runner.status().message()));
  Relay relay(channel_, options_.relay);
  Attend(**runner, relay);
  if (!why_.empty()) Say(why_);
  return SayGoodbye(relay, EndOf(**runner));
}

}  // namespace

int PlayLease(LeaseChannel& channel, const PlayOptions& options) {
  return Play(channel, options).Run();
}

}  // namespace myograde::server
