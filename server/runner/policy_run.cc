#include "server/runner/policy_run.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/clock.h"
#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/sim_channel.h"
#include "server/base/plain_text.h"
#include "server/sandbox/sandbox_config.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

// A flood is read in slices, between other work.
constexpr int kReadsPerDrain = 16;
constexpr size_t kQuotedBytes = 300;
// So few sockets can't hold much. Beyond that, their bytes are counted some fifteen times a second: the
// kernel has to list them, and episodes that end at once must not be over before.
constexpr int64_t kFewSockets = 32;
constexpr int64_t kSamplesPerCount = 3;
// Time for the sandbox to end by itself, as its own exit says more than our kill.
constexpr absl::Duration kLastMoments = absl::Milliseconds(300);

// The last line of the output that has a letter or digit, at most kQuotedBytes of it: the last one of
// some errors is a bracket.
std::string LastLine(std::string text) {
  const auto end = std::find_if(text.rbegin(), text.rend(), [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) || (c & 0x80) != 0;
  });
  if (end != text.rend()) {
    text.erase(std::min(text.find('\n', static_cast<size_t>(text.rend() - end)), text.size()));
  }
  while (!text.empty() && text.back() == '\n') text.pop_back();
  if (const size_t line = text.rfind('\n'); line != std::string::npos) text.erase(0, line + 1);
  return std::string(LastOf(text, kQuotedBytes));
}

// The library that the dynamic loader could not find, from the last line of its error message; ""
// if the line is something else.
std::string MissingLibrary(const std::string& line) {
  constexpr std::string_view kComplaint = "error while loading shared libraries: ";
  const size_t at = line.find(kComplaint);
  if (at == std::string::npos) return "";
  const size_t begin = at + kComplaint.size();
  return line.substr(begin, line.find(": ", begin) - begin);
}

// Whether a submission holds the generated code of a MyoChallenge's agent template, whose agents
// speak gRPC. Looks at so many names that it takes no time.
bool HoldsTemplate(const std::string& folder) {
  constexpr int kMostNames = 20'000;
  constexpr int kMostDepth = 5;
  std::error_code error;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error);
  for (int names = 0; !error && it != fs::recursive_directory_iterator() && names < kMostNames; ++names) {
    if (it->path().filename() == "evaluation_pb2_grpc.py") return true;
    // An image's own system.
    const bool system = it.depth() == 1 && (it->path().filename() == "usr" || it->path().filename() == "lib");
    if (system || it.depth() >= kMostDepth) it.disable_recursion_pending();
    it.increment(error);
  }
  return false;
}

bool IsTimeout(Outcome outcome) {
  return outcome == Outcome::kInitTimeout || outcome == Outcome::kStepTimeout ||
         outcome == Outcome::kWallTimeout;
}

bool MayHideACause(Outcome outcome) { return outcome == Outcome::kCrash || IsTimeout(outcome); }

// The bridge reports the wait status of a policy that ended as the value.
bool WasEndedBy(const FaultEvidence& evidence, int signal) {
  const auto status = static_cast<int>(evidence.value);
  return WIFSIGNALED(status) && WTERMSIG(status) == signal;
}

// For a sandbox that was never built and said nothing. Only somebody outside kills one.
std::string SilentEnd(int wait_status) {
  return WIFSIGNALED(wait_status)
             ? absl::StrCat("bubblewrap was killed by signal ", WTERMSIG(wait_status),
                            ", which nothing of this lease sends")
             : absl::StrCat("bubblewrap ended with status ", WEXITSTATUS(wait_status),
                            " and gave no reason");
}

}  // namespace

absl::StatusOr<std::unique_ptr<PolicyRun>> PolicyRun::Prepare(const LeaseContext& context,
                                                              int number, Fd bridge_socket,
                                                              OutputTail& out, OutputTail& err) {
  const LeaseOrder& order = context.order;
  const Budgets& budgets = order.track.budgets;
  std::unique_ptr<PolicyRun> run(new PolicyRun(context, out, err));
  ASSIGN_OR_RETURN(
      run->scratch_,
      context.stage.MountScratch(number, budgets.scratch_bytes, budgets.scratch_files));
  run->err_mark_ = err.total();
  run->group_ = ControlGroup::Create(GroupName(std::to_string(number)), PolicyGroupLimits(budgets));
  ASSIGN_OR_RETURN(Fd filter, MakeSeccompFilter(context.config.policy));
  ASSIGN_OR_RETURN(Pipe stdout_pipe, MakeOutputPipe());
  ASSIGN_OR_RETURN(Pipe stderr_pipe, MakeOutputPipe());
  Fd nothing(open("/dev/null", O_RDONLY | O_CLOEXEC));
  ASSIGN_OR_RETURN(const SandboxSpec spec,
                   MakePolicySandbox(order, context.config.policy, context.bin_dir, context.stage,
                                     context.etc, run->scratch_, run->group_->controllers()));
  ASSIGN_OR_RETURN(run->sandbox_, Sandbox::Start(spec,
                     {{nothing.get(), 0},
                      {stdout_pipe.write.get(), 1},
                      {stderr_pipe.write.get(), 2},
                      {bridge_socket.get(), kBridgeSocketFd}},
                     run->group_->join_fds(), filter));
  if (!run->group_->controllers().cpu_account) {
    run->tree_.emplace(run->sandbox_->pid(), absl::Seconds(context.config.policy.cpu_refresh_s));
  }
  run->stdout_ = std::move(stdout_pipe.read);
  run->stderr_ = std::move(stderr_pipe.read);
  return run;
}

PolicyRun::~PolicyRun() {
  End();
  sandbox_.reset();
  group_.reset();
  context_.stage.UnmountScratch(scratch_);
}

void PolicyRun::Sample() {
  if (ended_) return;
  disk_ = Stage::MeasureUsage(scratch_);
  const NetworkUse use = sandbox_->network()->Sample();
  sockets_ = std::max(sockets_, use.sockets);
  all_sockets_ = std::max(all_sockets_, use.all_sockets);
  pool_full_ = pool_full_ || use.pool_full;
  if (use.sockets > kFewSockets && samples_++ % kSamplesPerCount == 0) CountSocketBytes();
  // Enforced at once: what they hold is taken from others.
  const PolicySandboxConfig& config = context_.config.policy;
  if (sockets_ > config.sockets || all_sockets_ > config.all_sockets) sandbox_->KillNow();
}

void PolicyRun::DrainOutput() {
  DrainInto(stdout_, kReadsPerDrain, out_);
  DrainInto(stderr_, kReadsPerDrain, err_);
}

int64_t PolicyRun::CpuNs(bool by_chance) {
  if (!ended_ && sandbox_ != nullptr) {
    cpu_ns_ = std::max(cpu_ns_, tree_.has_value() ? tree_->CpuNs(by_chance) : group_->cpu_ns());
  }
  return cpu_ns_;
}

std::vector<pid_t> PolicyRun::Processes() const {
  return tree_.has_value() ? tree_->members() : group_->Members();
}

bool PolicyRun::KernelCause(FaultEvidence& evidence) const {
  const Budgets& budgets = context_.order.track.budgets;
  const auto blame = [&](Outcome outcome, const char* limit, int64_t most, int64_t value,
                         const std::string& what) {
    evidence.outcome = outcome;
    evidence.limit = limit;
    evidence.limit_value = static_cast<double>(most);
    evidence.value = static_cast<double>(value);
    evidence.detail = absl::StrCat("the policy ", what, "; ", evidence.detail);
    return true;
  };
  if (const int64_t most = context_.config.policy.sockets; sockets_ > most) {
    return blame(Outcome::kMemoryLimit, "sockets", most, sockets_,
                 absl::StrCat("had ", sockets_, " network sockets of the ", most,
                              " that it may use at one time, whose buffers are the whole host's "
                              "memory, and was stopped"));
  }
  if (const int64_t all = context_.config.policy.all_sockets; all_sockets_ > all) {
    return blame(Outcome::kMemoryLimit, "all_sockets", all, all_sockets_,
                 absl::StrCat("had ", all_sockets_, " sockets of the ", all,
                              " that it may have open at one time, and was stopped"));
  }
  if (overdrawn_ || group_->oom_kills() > 0) {
    const std::string sockets =
        socket_bytes_ > 0 ? absl::StrCat(" (up to ", socket_bytes_, " of them in its sockets)") : "";
    return blame(Outcome::kMemoryLimit, "memory_bytes", budgets.memory_bytes,
                 group_->peak_memory_bytes() + socket_bytes_,
                 absl::StrCat("used all of its ", budgets.memory_bytes, " bytes of memory", sockets,
                              " and was stopped"));
  }
  if (group_->refused_tasks() > 0) {
    return blame(Outcome::kProcessLimit, "tasks", budgets.tasks, budgets.tasks + 1,
                 absl::StrCat("wanted more than ", budgets.tasks, " processes and threads"));
  }
  if (evidence.outcome != Outcome::kCrash) return false;
  if (WasEndedBy(evidence, SIGXFSZ)) {
    // A file that would have grown past the limit.
    return blame(Outcome::kDiskLimit, "scratch_bytes", budgets.scratch_bytes,
                 budgets.scratch_bytes + 1,
                 absl::StrCat("made a file longer than ", budgets.scratch_bytes, " bytes"));
  }
  if (!disk_.full()) return false;
  const bool files = disk_.free_files == 0;
  return blame(Outcome::kDiskLimit, files ? "scratch_files" : "scratch_bytes",
               files ? budgets.scratch_files : budgets.scratch_bytes,
               files ? disk_.files : disk_.bytes,
               absl::StrCat("filled its /tmp and /dev/shm (", disk_.bytes, " bytes and ",
                            disk_.files, " files of ", budgets.scratch_bytes, " and ",
                            budgets.scratch_files, ") and ended"));
}

void PolicyRun::CountSocketBytes() {
  const int64_t bytes = sandbox_->network()->socket_bytes();
  socket_bytes_ = std::max(socket_bytes_, bytes);
  if (group_->Withhold(bytes)) return;
  overdrawn_ = true;
  sandbox_->KillNow();
}

void PolicyRun::EpisodeOver() {
  pool_full_ = false;
  dropped_ = sandbox_->network()->dropped();
}

// Messages were lost because memory ran out that the policy shares with others.
void PolicyRun::ExcuseLostMessages(FaultEvidence& evidence) const {
  if (!pool_full_ && sandbox_->network()->dropped() == dropped_) return;
  evidence.outcome = Outcome::kGraderError;
  evidence.detail = absl::StrCat(
      "the UDP sockets of the whole host held all the memory that they may (sysctl "
      "net.ipv4.udp_mem) and the kernel drops messages then, so nobody can tell whether the policy "
      "was late; ", evidence.detail);
}

FaultEvidence PolicyRun::Rule(FaultEvidence seen) {
  // A full disk counts if it was full at the last sample: the ended processes may have taken their
  // files along.
  if (!disk_.full()) Sample();
  if (seen.outcome == Outcome::kCrash) sandbox_->Wait(kLastMoments);
  DrainOutput();
  const bool by_itself = sandbox_->Ended();
  const SandboxEnd end = sandbox_->end();
  const bool caused = MayHideACause(seen.outcome) && KernelCause(seen);
  if (!caused && IsTimeout(seen.outcome)) ExcuseLostMessages(seen);
  // What can't be killed now is waited for before the next run; how this run ended is known.
  End();
  DrainOutput();
  const std::string words = LastLine(err_.tail(err_mark_));
  if (!caused && by_itself && !end.started) {
    seen.outcome = Outcome::kGraderError;
    seen.detail = absl::StrCat("the participant's sandbox could not be built: ",
                               words.empty() ? SilentEnd(end.wait_status) : words);
  } else if (seen.outcome == Outcome::kCrash && !words.empty()) {
    absl::StrAppend(&seen.detail, "; the last line of its stderr: ", words);
    if (const std::string library = MissingLibrary(words); !library.empty()) {
      absl::StrAppend(&seen.detail, "; the sandbox does not have ", library,
                      ": put it into the submission, and its folder (as /policy/lib) into "
                      "LD_LIBRARY_PATH in the env of policy.json");
    }
  }
  const LeaseOrder& order = context_.order;
  if ((seen.outcome == Outcome::kCrash || seen.outcome == Outcome::kInitTimeout) &&
      order.adapter.empty() && order.track.kind->template_year != 0 &&
      HoldsTemplate(context_.stage.PathOf(order.artefact_dir))) {
    absl::StrAppend(&seen.detail,
                    "; it holds the agent template of a MyoChallenge, whose agents need an "
                    "adapter: submit it with \"adapter\": \"template-",
                    order.track.kind->template_year, "\" in policy.json");
  }
  seen.stderr_tail = err_.tail(err_mark_);
  return seen;
}

bool PolicyRun::End() {
  if (ended_) return Gone();
  CpuNs();
  const Deadline deadline(absl::Seconds(context_.config.policy.kill_s));
  bool gone = sandbox_ == nullptr || sandbox_->Kill(deadline.left());
  if (group_ != nullptr) gone = group_->KillAll(deadline.left()) && gone;
  if (!tree_.has_value()) CpuNs();
  ended_ = true;
  return gone;
}

bool PolicyRun::Gone() {
  return (sandbox_ == nullptr || sandbox_->Gone()) &&
         (group_ == nullptr || group_->Members().empty());
}

}  // namespace myograde::server
