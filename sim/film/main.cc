// myograde-render: draws recorded episodes. README.md beside this file has the order that it reads
// from standard input, and what it writes to standard output.
//
// Exit status: RenderExit (protocol/lease/render_order.h), with one sentence on standard error.
#include <fcntl.h>
#include <grp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/ascii_line.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/pinned_maths.h"
#include "protocol/base/status_macros.h"
#include "protocol/lease/render_order.h"
#include "sim/confine.h"
#include "sim/film/renders.h"

namespace myograde::sim {
namespace {

constexpr size_t kMaxRenderOrderBytes = 16u << 20;
constexpr uid_t kNobody = 65534;

// What drawing needs once everything is loaded. Mesa's threads wait for each other by futex and
// sched_yield, and nothing is opened any more.
const std::vector<std::string> kDrawingCalls = {
    "brk",   "clock_gettime",  "clock_nanosleep", "close",  "exit",        "exit_group",
    "fstat", "futex",          "getpid",          "getrandom", "gettid",   "gettimeofday",
    "lseek", "madvise",        "mmap",            "mprotect",  "mremap",   "munmap",
    "nanosleep", "newfstatat", "read",            "restart_syscall", "rt_sigprocmask",
    "rt_sigreturn", "sched_getaffinity", "sched_yield", "set_robust_list", "sysinfo", "tgkill", "write",
    "writev"};

// Ends the program by SIGALRM when the time is up, behind the filter as well.
void SetDeadline(double seconds) {
  // Whoever started it may have ignored or blocked the signal.
  signal(SIGALRM, SIG_DFL);
  sigset_t alarm;
  sigemptyset(&alarm);
  sigaddset(&alarm, SIGALRM);
  sigprocmask(SIG_UNBLOCK, &alarm, nullptr);
  itimerval timer = {};
  timer.it_value.tv_sec = static_cast<time_t>(std::ceil(seconds));
  setitimer(ITIMER_REAL, &timer, nullptr);
}

// Mesa is told before it is loaded.
void ConfigureMesa(int threads) {
  setenv("GALLIUM_DRIVER", "llvmpipe", /*overwrite=*/1);
  // Its own threads beside this one; with 0 this one draws.
  setenv("LP_NUM_THREADS", std::to_string(threads > 1 ? threads : 0).c_str(), /*overwrite=*/1);
  setenv("MESA_SHADER_CACHE_DISABLE", "true", /*overwrite=*/1);
}

// What libraries print to standard output must not get among the pictures.
absl::StatusOr<Fd> TakeOutput() {
  Fd out(fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1));
  if (!out.valid() || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
    return absl::InternalError(absl::StrCat("there is no standard output: ", strerror(errno)));
  }
  return out;
}

// Root has rights that no picture needs. Where there is no such user (a container that maps one user
// only), "root" is none either.
void GiveUpRoot() {
  if (geteuid() != 0 || setgroups(0, nullptr) != 0) return;
  if (setresgid(kNobody, kNobody, kNobody) != 0) return;
  if (setresuid(kNobody, kNobody, kNobody) != 0) return;
}

absl::Status Confine() {
  const rlimit none = {0, 0};
  setrlimit(RLIMIT_CORE, &none);
  GiveUpRoot();
  prctl(PR_SET_DUMPABLE, 0);
  return AllowOnly(kDrawingCalls, NewCode::kCompiled);
}

absl::StatusOr<RenderOrder> ReadRenderOrder() {
  ASSIGN_OR_RETURN(std::string text, ReadAll(STDIN_FILENO, "the order", kMaxRenderOrderBytes));
  ASSIGN_OR_RETURN(nlohmann::json json, ParseJson(text, "order"));
  return RenderOrderFromJson(json, "order");
}

absl::Status Render() {
  absl::StatusOr<RenderOrder> order = ReadRenderOrder();
  if (!order.ok()) return absl::InvalidArgumentError(order.status().message());
  ASSIGN_OR_RETURN(Fd out, TakeOutput());
  SetDeadline(order->deadline_s);
  ConfigureMesa(order->threads);
  absl::StatusOr<Renders> renders = Renders::Prepare(*std::move(order));
  // What is wrong with a model or config is no fault of a log.
  if (!renders.ok()) return absl::InternalError(renders.status().message());
  // Logs come from anywhere: they are read behind the filter.
  RETURN_IF_ERROR(Confine());
  return renders->Write(out.get());
}

int Main(int argc, char** argv) {
  const std::string_view word = argc > 1 ? argv[1] : "";
  const bool asked = word == "--help";
  if (argc > 1) {
    std::fprintf(asked ? stdout : stderr,
                 "usage: myograde-render < ORDER > PICTURES\n"
                 "Draws recorded episodes: a film as raw pictures, a picture or a strip as PNG.\n"
                 "ORDER is JSON (sim/film/README.md); `myograde episode render` and the daemon write it.\n"
                 "Exit status: 0 done, 1 the host or the order is at fault, 2 usage error,\n"
                 "3 a log can't be shown.\n");
    return asked ? kRendered : kRenderWrongUse;
  }
  absl::Status status = PinMaths(argv);
  if (status.ok()) status = Render();
  if (status.ok()) return kRendered;
  std::fprintf(stderr, "myograde-render: %s\n", AsciiLine(std::string(status.message())).c_str());
  return absl::IsDataLoss(status) ? kRenderLogFault : kRenderTrouble;
}

}  // namespace
}  // namespace myograde::sim

// _exit: destructors of OpenGL may want calls that the filter has not, and everything is written.
int main(int argc, char** argv) {
  const int status = myograde::sim::Main(argc, argv);
  std::fflush(nullptr);
  _exit(status);
}
