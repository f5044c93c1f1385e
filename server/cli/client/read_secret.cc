#include "server/cli/client/read_secret.h"

#include <absl/strings/ascii.h>
#include <signal.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <iostream>

namespace myograde::server {
namespace {

constexpr size_t kMaxLine = 4096;

termios shown;  // the terminal as it was

void ShowAgain() { ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &shown); }

void OnInterrupt(int signal) {
  ShowAgain();
  ::signal(signal, SIG_DFL);
  ::raise(signal);
}

// While it lives, a terminal at standard input does not show what is typed. A signal that ends the
// program ends that too.
class Hidden {
 public:
  Hidden() : terminal_(::tcgetattr(STDIN_FILENO, &shown) == 0) {
    if (!terminal_) return;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) ::signal(signal, OnInterrupt);
    termios hidden = shown;
    hidden.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &hidden);
  }
  ~Hidden() {
    if (!terminal_) return;
    ShowAgain();
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) ::signal(signal, SIG_DFL);
    std::cerr << std::endl;  // the one that was typed was not shown
  }
  Hidden(const Hidden&) = delete;
  Hidden& operator=(const Hidden&) = delete;

 private:
  const bool terminal_;
};

}  // namespace

absl::StatusOr<std::string> ReadSecret(const std::string& prompt) {
  const Hidden hidden;  // before anything is typed; what was typed before is dropped
  if (::isatty(STDIN_FILENO) == 1) std::cerr << prompt << std::flush;
  std::string line;
  for (char byte = 0; line.size() < kMaxLine;) {
    const ssize_t n = ::read(STDIN_FILENO, &byte, 1);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0 || byte == '\n') break;
    line += byte;
  }
  absl::StripAsciiWhitespace(&line);
  if (line.empty()) {
    return absl::InvalidArgumentError(
        "no token was given; type it, or have it on standard input: myograde login URL < FILE");
  }
  return line;
}

}  // namespace myograde::server
