#include "protocol/bridge/bridge.h"

#include <poll.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "protocol/base/status_macros.h"
#include "protocol/bridge/child.h"
#include "protocol/bridge/start_failure.h"
#include "protocol/bridge/bus.h"
#include "protocol/policy/channels.h"

namespace myograde::bridge {
namespace {

constexpr absl::Duration kFirstResend = absl::Milliseconds(50);
constexpr absl::Duration kLongestResend = absl::Milliseconds(250);
// How long to wait for an answer on the bus alone. A quick policy answers sooner, which saves the
// poll; with a slow one this delays noticing its death or the simulator's.
constexpr auto kQuickAnswer = std::chrono::milliseconds(10);
// Datagrams handled before the simulator is read again, so that a flood on the bus can't keep it
// waiting.
constexpr int kDatagramsPerTurn = 64;
// After the policy's exit: what it had sent before is still handled first.
constexpr int kDatagramsAfterExit = 4096;

std::string_view ChannelName(Channel channel) {
  switch (channel) {
    case Channel::kWelcome:
      return kWelcomeChannel;
    case Channel::kEpisodeStart:
      return kStartChannel;
    case Channel::kObservation:
      return kObservationChannel;
    case Channel::kEpisodeEnd:
      return kEndChannel;
  }
  return {};
}

// "SEGV"; the number for signals without a name.
std::string SignalName(int number) {
  const char* name = sigabbrev_np(number);
  return name != nullptr ? name : absl::StrCat(number);
}

class Bridge {
 public:
  Bridge(Fd simulator, Bus bus, Fd children, std::string program, const BridgeOptions& options)
      : simulator_(std::move(simulator)),
        bus_(std::move(bus)),
        children_(std::move(children)),
        program_(std::move(program)),
        farewell_(options.farewell),
        inbox_(options.limits) {}

  absl::Status Run(Child policy);

 private:
  absl::Status QuickTurn();
  absl::Status RunOnce();
  int PollTimeout() const;
  absl::StatusOr<bool> ReadSimulator(int flags);
  absl::Status ReadBus(int most);
  absl::Status HandleDatagram(std::span<const std::byte> datagram);
  absl::Status ReapChildren();
  std::optional<int> Reap();
  absl::Status ReadStartError();
  void AwaitPolicyExit();
  absl::Status SendFrame(std::span<const std::byte> frame);
  absl::Status SendFault(const FaultFrame& frame);
  void Publish();
  void ResendIfDue();
  std::span<const std::byte> payload() const {
    return {outbound_.payload, outbound_.payload_size};
  }

  Fd simulator_;
  Bus bus_;
  Fd children_;
  Child policy_;
  bool policy_ended_ = false;
  const std::string program_;
  const absl::Duration farewell_;
  Inbox inbox_;
  bool done_ = false;     // the simulator hung up
  bool faulted_ = false;  // the simulator was told; wait only for it to hang up
  PublishFrame outbound_;
  std::vector<std::byte> welcome_;  // for a policy that missed it; set once
  absl::Duration resend_wait_ = kFirstResend;
  absl::Duration resend_at_;
};

absl::Status Bridge::Run(Child policy) {
  policy_ = std::move(policy);
  while (!done_) {
    RETURN_IF_ERROR(QuickTurn());
    if (done_) break;
    RETURN_IF_ERROR(RunOnce());
  }
  // A policy at fault gets no farewell.
  if (!faulted_) AwaitPolicyExit();
  return absl::OkStatus();
}

// Asks the policy to exit, so that its processes can flush their output, and waits.
void Bridge::AwaitPolicyExit() {
  const absl::Duration deadline = SystemClock().Monotonic() + farewell_;
  if (farewell_ > absl::ZeroDuration() && !policy_ended_) {
    // The policy's session; the process alone if it has not created the session yet.
    if (kill(-policy_.pid, SIGTERM) != 0) kill(policy_.pid, SIGTERM);
  }
  while (!policy_ended_) {
    const absl::Duration left = deadline - SystemClock().Monotonic();
    if (left <= absl::ZeroDuration()) return;
    pollfd entry = {children_.get(), POLLIN, 0};
    poll(&entry, 1, static_cast<int>(absl::ToInt64Milliseconds(left)) + 1);
    Reap();
  }
}

// Handles steps that are answered at once, with only the calls that move their bytes. Returns when
// one takes longer or anything else happens, so that RunOnce handles every event source.
absl::Status Bridge::QuickTurn() {
  int unheeded = 0;
  while (!faulted_ && !done_ && outbound_.channel == Channel::kObservation &&
         outbound_.header.size != 0 && unheeded < kDatagramsPerTurn) {
    if (!inbox_.waiting()) {
      // The policy owes no answer, so only the simulator can proceed.
      unheeded = 0;
      absl::StatusOr<bool> heard = ReadSimulator(0);
      if (!heard.ok() || !*heard) return heard.status();
      continue;
    }
    const std::span<const std::byte> datagram = bus_.Await();
    if (datagram.empty()) break;
    ++unheeded;
    RETURN_IF_ERROR(HandleDatagram(datagram));
  }
  return absl::OkStatus();
}

int Bridge::PollTimeout() const {
  if (!inbox_.waiting() || outbound_.header.size == 0) return -1;  // the simulator's EOF wakes us
  const absl::Duration left = resend_at_ - SystemClock().Monotonic();
  return static_cast<int>(absl::ToInt64Milliseconds(std::max(left, absl::ZeroDuration()))) + 1;
}

absl::Status Bridge::RunOnce() {
  // poll ignores negative descriptors.
  std::array<pollfd, 4> entries = {{{simulator_.get(), POLLIN, 0},
                                    {faulted_ ? -1 : bus_.fd(), POLLIN, 0},
                                    {children_.get(), POLLIN, 0},
                                    {policy_.start_error.get(), POLLIN, 0}}};
  if (poll(entries.data(), entries.size(), PollTimeout()) < 0 && errno != EINTR) {
    return absl::InternalError(absl::StrCat("poll: ", strerror(errno)));
  }
  absl::Status status;
  if (entries[0].revents != 0) status.Update(ReadSimulator(MSG_DONTWAIT).status());
  if (entries[1].revents != 0) status.Update(ReadBus(kDatagramsPerTurn));
  if (entries[3].revents != 0) status.Update(ReadStartError());
  if (entries[2].revents != 0) status.Update(ReapChildren());
  if (!faulted_) ResendIfDue();
  return status;
}

// True if a message arrived.
absl::StatusOr<bool> Bridge::ReadSimulator(int flags) {
  const ssize_t size = recv(simulator_.get(), &outbound_, sizeof(outbound_), flags);
  if (size == 0 || (size < 0 && errno == ECONNRESET)) {
    done_ = true;
    return false;
  }
  if (size < 0) {
    if (errno == EAGAIN || errno == EINTR) return false;
    return absl::InternalError(absl::StrCat("reading the simulator's socket: ", strerror(errno)));
  }
  constexpr size_t kHead = offsetof(PublishFrame, payload);
  const auto bytes = static_cast<size_t>(size);
  if (bytes < kHead || outbound_.header.magic != kFrameMagic ||
      outbound_.header.version != kFrameVersion ||
      outbound_.header.type != FrameType::kPublish || outbound_.header.size != bytes ||
      outbound_.payload_size != bytes - kHead || ChannelName(outbound_.channel).empty()) {
    return absl::InternalError("the simulator sent a broken frame");
  }
  // Anything the policy sent before it was asked is not an answer.
  RETURN_IF_ERROR(ReadBus(kDatagramsPerTurn));
  if (faulted_) return true;
  inbox_.Ask(outbound_);
  Publish();
  if (outbound_.channel == Channel::kWelcome) {
    welcome_.assign(payload().begin(), payload().end());
  }
  return true;
}

void Bridge::Publish() {
  bus_.Send(ChannelName(outbound_.channel), payload());
  resend_wait_ = kFirstResend;
  resend_at_ = SystemClock().Monotonic() + resend_wait_;
}

void Bridge::ResendIfDue() {
  if (!inbox_.waiting() || outbound_.header.size == 0) return;
  const absl::Duration now = SystemClock().Monotonic();
  if (now < resend_at_) return;
  bus_.Send(ChannelName(outbound_.channel), payload());
  inbox_.AskedAgain();
  resend_wait_ = std::min(2 * resend_wait_, kLongestResend);
  resend_at_ = now + resend_wait_;
}

absl::Status Bridge::ReadBus(int most) {
  for (int i = 0; i < most && !faulted_; ++i) {
    const std::span<const std::byte> datagram = bus_.Receive();
    if (datagram.empty()) break;
    RETURN_IF_ERROR(HandleDatagram(datagram));
  }
  return absl::OkStatus();
}

absl::Status Bridge::HandleDatagram(std::span<const std::byte> datagram) {
  switch (inbox_.Take(datagram)) {
    case Disposition::kDropped:
      break;
    case Disposition::kResendWelcome:
      if (!welcome_.empty()) bus_.Send(kWelcomeChannel, welcome_);
      break;
    case Disposition::kFault:
      faulted_ = true;
      return SendFrame(inbox_.frame());
    case Disposition::kFrame:
      return SendFrame(inbox_.frame());
  }
  return absl::OkStatus();
}

absl::Status Bridge::ReadStartError() {
  int error = 0;
  const ssize_t size = read(policy_.start_error.get(), &error, sizeof(error));
  policy_.start_error.reset();
  if (size != static_cast<ssize_t>(sizeof(error))) return absl::OkStatus();
  return SendFault(MakeFault(BridgeFault::kStartFailed, error, ExplainStart(program_, error)));
}

// The wait status of the policy's process, if that is what exited.
std::optional<int> Bridge::Reap() {
  signalfd_siginfo information;
  [[maybe_unused]] const ssize_t drained =
      read(children_.get(), &information, sizeof(information));
  int wait_status = 0;
  std::optional<int> policy_status;
  // As process 1 the bridge also inherits the policy's orphans.
  for (pid_t pid; (pid = waitpid(-1, &wait_status, WNOHANG)) > 0;) {
    if (pid == policy_.pid && !policy_ended_) policy_status = wait_status;
  }
  policy_ended_ = policy_ended_ || policy_status.has_value();
  return policy_status;
}

absl::Status Bridge::ReapChildren() {
  const std::optional<int> ended = Reap();
  if (!ended.has_value() || faulted_) return absl::OkStatus();
  const int policy_status = *ended;
  if (policy_.start_error.valid()) {
    if (absl::Status status = ReadStartError(); !status.ok() || faulted_) return status;
  }
  if (absl::Status status = ReadBus(kDatagramsAfterExit); !status.ok() || faulted_) {
    return status;
  }
  const std::string how =
      WIFSIGNALED(policy_status)
          ? absl::StrCat("was ended by SIG", SignalName(WTERMSIG(policy_status)))
          : absl::StrCat("exited with status ", WEXITSTATUS(policy_status));
  return SendFault(MakeFault(BridgeFault::kPolicyExit, policy_status,
                             absl::StrCat("the policy's process ", how)));
}

absl::Status Bridge::SendFault(const FaultFrame& frame) {
  if (faulted_) return absl::OkStatus();
  faulted_ = true;
  return SendFrame(std::as_bytes(std::span<const FaultFrame, 1>(&frame, 1)));
}

absl::Status Bridge::SendFrame(std::span<const std::byte> frame) {
  const ssize_t sent =
      send(simulator_.get(), frame.data(), frame.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (sent == static_cast<ssize_t>(frame.size())) return absl::OkStatus();
  if (errno == EPIPE || errno == ECONNRESET) {
    done_ = true;
    return absl::OkStatus();
  }
  return absl::UnavailableError(absl::StrCat("telling the simulator failed: ", strerror(errno)));
}

absl::StatusOr<Fd> WatchChildren() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGCHLD);
  if (sigprocmask(SIG_BLOCK, &signals, nullptr) != 0) {
    return absl::InternalError(absl::StrCat("sigprocmask: ", strerror(errno)));
  }
  Fd fd(signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK));
  if (!fd.valid()) return absl::InternalError(absl::StrCat("signalfd: ", strerror(errno)));
  return fd;
}

}  // namespace

absl::Status RunBridge(Fd simulator, const BridgeOptions& options, const PolicyCommand& command) {
  ASSIGN_OR_RETURN(Bus bus, Bus::Open(kBusUrl, kQuickAnswer));
  ASSIGN_OR_RETURN(Fd children, WatchChildren());
  ASSIGN_OR_RETURN(Child policy, StartPolicy(command));
  // On the heap: its buffers are too large for the stack.
  auto bridge = std::make_unique<Bridge>(std::move(simulator), std::move(bus),
                                         std::move(children), command.words[0], options);
  return bridge->Run(std::move(policy));
}

}  // namespace myograde::bridge
