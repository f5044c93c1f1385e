#include "tests/protocol/bridge/bridge_world.h"

#include <fcntl.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/lease/sim_channel.h"

namespace myograde {
namespace {

bool WriteFile(const char* path, const std::string& text) {
  const Fd file(open(path, O_WRONLY | O_CLOEXEC));
  return write(file.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

// Become root of a new user namespace, for hosts where the caller is an ordinary user.
bool BecomeRoot() {
  const uid_t uid = getuid();
  const gid_t gid = getgid();
  return unshare(CLONE_NEWUSER) == 0 && WriteFile("/proc/self/setgroups", "deny") &&
         WriteFile("/proc/self/uid_map", absl::StrCat("0 ", uid, " 1")) &&
         WriteFile("/proc/self/gid_map", absl::StrCat("0 ", gid, " 1"));
}

}  // namespace

absl::Status EnterPrivateBus() {
  if (geteuid() != 0 && !BecomeRoot()) {
    return absl::UnavailableError("no user namespaces for this user");
  }
  if (unshare(CLONE_NEWNET) != 0) {
    return absl::UnavailableError(absl::StrCat("no network namespace: ", strerror(errno)));
  }
  if (std::system("ip link set lo up multicast on && ip route add 239.255.0.0/16 dev lo") != 0) {
    return absl::UnavailableError("the loopback can't be set up with ip(8)");
  }
  return absl::OkStatus();
}

BridgeWorld::BridgeWorld(const std::vector<std::string>& command,
                         const std::vector<std::string>& options) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) std::abort();
  socket_ = Fd(ends[0]);
  const Fd theirs(ends[1]);
  std::vector<std::string> words = {std::string(MYOGRADE_BIN_DIR) + "/myograde-bridge",
                                    "--stray", "50", "--wrong", "5"};
  words.insert(words.end(), options.begin(), options.end());
  words.emplace_back("--");
  words.insert(words.end(), command.begin(), command.end());
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  // Process 1 of a namespace, as in a sandbox: the policy's processes die with it.
  pid_ = static_cast<pid_t>(syscall(SYS_clone, CLONE_NEWPID | SIGCHLD, 0, 0, 0, 0));
  if (pid_ < 0) std::abort();
  if (pid_ == 0) {
    if (theirs.get() == kBridgeSocketFd) {
      fcntl(theirs.get(), F_SETFD, 0);
    } else {
      dup2(theirs.get(), kBridgeSocketFd);
    }
    execv(arguments[0], arguments.data());
    _exit(126);
  }
}

BridgeWorld::~BridgeWorld() {
  if (pid_ > 0) HangUp();
}

int BridgeWorld::HangUp() {
  socket_.reset();
  int status = -1;
  for (int i = 0; i < 3000 && waitpid(pid_, &status, WNOHANG) == 0; ++i) usleep(10000);
  if (status == -1) {
    kill(pid_, SIGKILL);
    waitpid(pid_, &status, 0);
  }
  pid_ = -1;
  return status;
}

absl::StatusOr<BridgeFrame> BridgeWorld::Receive(absl::Duration timeout) {
  const timeval limit = absl::ToTimeval(timeout);
  setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  std::vector<std::byte> bytes(sizeof(PublishFrame));
  const ssize_t size = recv(socket_.get(), bytes.data(), bytes.size(), 0);
  if (size == 0) return absl::UnavailableError("the bridge hung up");
  if (size < 0) return absl::DeadlineExceededError(strerror(errno));
  return ParseBridgeFrame({bytes.data(), static_cast<size_t>(size)});
}

void BridgeWorld::Send(Channel channel, Expect expect, int64_t episode, int64_t step,
                       uint32_t action_size, const std::vector<std::byte>& payload) {
  const auto frame = std::make_unique<PublishFrame>();
  const size_t size = offsetof(PublishFrame, payload) + payload.size();
  frame->header = MakeHeader<PublishFrame>(FrameType::kPublish, size);
  frame->channel = channel;
  frame->expect = expect;
  frame->episode = episode;
  frame->step = step;
  frame->action_size = action_size;
  frame->payload_size = static_cast<uint32_t>(payload.size());
  std::memcpy(frame->payload, payload.data(), payload.size());
  if (send(socket_.get(), frame.get(), size, MSG_NOSIGNAL) != static_cast<ssize_t>(size)) {
    std::abort();
  }
}

}  // namespace myograde
