// myograde-bridge: process 1 of a participant's sandbox. See bridge.h.
//
//   myograde-bridge --stray N --wrong N [--farewell MS] [--cwd FOLDER] [--env NAME=VALUE]... --
//                   COMMAND ARGUMENTS...
//
// Exit status: 0 the simulator hung up, 2 wrong use, 70 the sandbox is unusable (no bus, no
// process).
#include <fcntl.h>
#include <sys/prctl.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocol/base/fd.h"
#include "protocol/bridge/bridge.h"
#include "protocol/lease/sim_channel.h"

namespace myograde::bridge {
namespace {

constexpr int kWrongUse = 2;
constexpr int kBrokenSandbox = 70;

struct Arguments {
  BridgeOptions options = {{0, 0}, absl::ZeroDuration()};
  PolicyCommand command;
};

std::optional<int64_t> PositiveNumber(std::string_view text) {
  int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value <= 0) return std::nullopt;
  return value;
}

bool TakeOption(const std::string& name, const std::string& value, Arguments& arguments) {
  if (name == "--env") {
    arguments.command.environment.push_back(value);
    return value.find('=') != std::string::npos && !value.starts_with('=');
  }
  if (name == "--cwd") {
    arguments.command.working_dir = value;
    return value.starts_with('/');
  }
  const std::optional<int64_t> number = PositiveNumber(value);
  if (!number.has_value()) return false;
  if (name == "--stray") {
    arguments.options.limits.stray_messages = *number;
  } else if (name == "--wrong") {
    arguments.options.limits.wrong_answers = *number;
  } else if (name == "--farewell") {
    arguments.options.farewell = absl::Milliseconds(*number);
  } else {
    return false;
  }
  return true;
}

std::optional<Arguments> Parse(const std::vector<std::string>& words) {
  Arguments arguments;
  size_t i = 0;
  for (; i < words.size() && words[i] != "--"; i += 2) {
    if (i + 1 == words.size() || !TakeOption(words[i], words[i + 1], arguments)) {
      return std::nullopt;
    }
  }
  const InboxLimits& limits = arguments.options.limits;
  if (i + 1 >= words.size() || limits.stray_messages == 0 || limits.wrong_answers == 0) {
    return std::nullopt;
  }
  arguments.command.words.assign(words.begin() + static_cast<std::ptrdiff_t>(i) + 1, words.end());
  return arguments;
}

int Main(int argc, char** argv) {
  // The policy has this process' uid. Not dumpable, so that the policy can't trace it, write to its
  // memory or take its descriptors.
  if (prctl(PR_SET_DUMPABLE, 0) != 0) {
    std::fprintf(stderr, "myograde-bridge: can't protect itself: %s\n", strerror(errno));
    return kBrokenSandbox;
  }
  const std::optional<Arguments> arguments = Parse({argv + 1, argv + argc});
  if (!arguments.has_value()) {
    std::fprintf(stderr,
                 "usage: myograde-bridge --stray N --wrong N [--farewell MS] [--cwd FOLDER] "
                 "[--env NAME=VALUE]... -- COMMAND ARGUMENTS...\n"
                 "N, MS: a number from 1; the simulator's socket is descriptor %d\n",
                 kBridgeSocketFd);
    return kWrongUse;
  }
  Fd simulator(kBridgeSocketFd);
  if (fcntl(simulator.get(), F_SETFD, FD_CLOEXEC) != 0) {
    std::fprintf(stderr, "myograde-bridge: descriptor %d is not open: start it from the runner\n",
                 kBridgeSocketFd);
    simulator.release();
    return kWrongUse;
  }
  signal(SIGPIPE, SIG_IGN);
  const absl::Status status =
      RunBridge(std::move(simulator), arguments->options, arguments->command);
  if (status.ok()) return 0;
  std::fprintf(stderr, "myograde-bridge: %s\n", std::string(status.message()).c_str());
  return kBrokenSandbox;
}

}  // namespace
}  // namespace myograde::bridge

int main(int argc, char** argv) { return myograde::bridge::Main(argc, argv); }
