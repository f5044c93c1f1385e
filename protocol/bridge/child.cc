#include "protocol/bridge/child.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/spawn.h"
#include "protocol/base/status_macros.h"
#include "protocol/bridge/start_failure.h"
#include "protocol/policy/channels.h"

namespace myograde::bridge {
namespace {

// Variables of the sandbox that the policy gets too.
constexpr const char* kPassedOn[] = {"PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED",
                                     "PYTHONHASHSEED", "OMP_NUM_THREADS"};

std::string NameOf(const std::string& variable) { return variable.substr(0, variable.find('=')); }

std::vector<std::string> PolicyEnvironment(const std::vector<std::string>& own) {
  const char* path = std::getenv("PATH");
  std::vector<std::string> environment = {
      absl::StrCat(kBusUrlVariable, "=", kBusUrl),
      absl::StrCat("MYOGRADE_PROTOCOL=", kProtocolVersion),
      "HOME=/tmp",
      "LANG=C.UTF-8",
      absl::StrCat("PATH=", path != nullptr ? path : "/usr/local/bin:/usr/bin:/bin"),
  };
  for (const char* name : kPassedOn) {
    if (const char* value = std::getenv(name); value != nullptr) {
      environment.push_back(absl::StrCat(name, "=", value));
    }
  }
  for (const std::string& variable : own) {
    std::erase_if(environment,
                  [&](const std::string& other) { return NameOf(other) == NameOf(variable); });
    environment.push_back(variable);
  }
  return environment;
}

// Between fork and exec: only async-signal-safe calls.
// `refused`: an errno that is known before, or 0.
[[noreturn]] void BecomePolicy(char* const* arguments, char* const* environment, int refused,
                               int errors) {
  setsid();
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  struct sigaction standard = {};
  standard.sa_handler = SIG_DFL;
  sigaction(SIGPIPE, &standard, nullptr);
  const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
  if (nothing >= 0 && dup2(nothing, STDIN_FILENO) == STDIN_FILENO) {
    // All of the bridge's own descriptors are close-on-exec; this covers any that it inherited
    // unknowingly.
    if (close_range(STDERR_FILENO + 1, ~0u, CLOSE_RANGE_CLOEXEC) == 0) {
      // execvpe passes a format that the kernel does not know to a shell, as a script.
      if (refused == 0) execvpe(arguments[0], arguments, environment);
      if (refused != 0) errno = refused;
    }
  }
  const int error = errno;
  [[maybe_unused]] const ssize_t written = write(errors, &error, sizeof(error));
  _exit(127);
}

}  // namespace

absl::StatusOr<Child> StartPolicy(const PolicyCommand& command) {
  ASSIGN_OR_RETURN(Pipe errors, MakeOutputPipe());
  Child child;
  child.start_error = std::move(errors.read);
  std::vector<std::string> words = command.words;
  std::vector<std::string> environment = PolicyEnvironment(command.environment);
  // The bridge itself goes there: a command's relative path begins there too.
  int refused = 0;
  if (!command.working_dir.empty() && chdir(command.working_dir.c_str()) != 0) refused = errno;
  if (refused == 0 && IsForeignProgram(FindProgram(words[0]))) refused = ENOEXEC;
  const std::vector<char*> arguments = ExecVector(words);
  const std::vector<char*> variables = ExecVector(environment);
  child.pid = fork();
  if (child.pid < 0) return absl::UnavailableError(absl::StrCat("fork: ", strerror(errno)));
  if (child.pid == 0) {
    BecomePolicy(arguments.data(), variables.data(), refused, errors.write.get());
  }
  return child;
}

}  // namespace myograde::bridge
