#include "server/artefact/unpack_process.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <memory>
#include <new>
#include <utility>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>
#include <seccomp.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/artefact/submission.h"
#include "server/base/child_process.h"

namespace myograde::server {
namespace {

// What unpacking and exiting need. Nothing here gives an existing file a new name (link, rename),
// or creates a device (mknod) or a process.
constexpr std::array kAllowed = {
    SCMP_SYS(brk),        SCMP_SYS(clock_gettime), SCMP_SYS(close),        SCMP_SYS(exit),
    SCMP_SYS(exit_group), SCMP_SYS(fchmod),        SCMP_SYS(fchmodat),     SCMP_SYS(fcntl),
    SCMP_SYS(fstat),      SCMP_SYS(futex),         SCMP_SYS(getdents64),   SCMP_SYS(getpid),
    SCMP_SYS(getrandom),  SCMP_SYS(gettid),        SCMP_SYS(gettimeofday), SCMP_SYS(lseek),
    SCMP_SYS(madvise),    SCMP_SYS(mkdirat),       SCMP_SYS(mremap),       SCMP_SYS(munmap),
    SCMP_SYS(newfstatat), SCMP_SYS(openat),        SCMP_SYS(openat2),      SCMP_SYS(pread64),
    SCMP_SYS(read),       SCMP_SYS(readlinkat),    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigreturn), SCMP_SYS(statx),       SCMP_SYS(symlinkat),    SCMP_SYS(time),
    // An image's upper layer removes and replaces what a lower one has.
    SCMP_SYS(unlinkat), SCMP_SYS(write)};

#if defined(__SANITIZE_ADDRESS__)
// What the sanitizers' reports and memory need.
constexpr std::array kSanitizerCalls = {
    SCMP_SYS(getcwd), SCMP_SYS(getrlimit), SCMP_SYS(ioctl),        SCMP_SYS(open),
    SCMP_SYS(pipe),   SCMP_SYS(pipe2),     SCMP_SYS(prctl),        SCMP_SYS(prlimit64),
    SCMP_SYS(readlink), SCMP_SYS(rt_sigaction), SCMP_SYS(sched_yield), SCMP_SYS(sigaltstack),
    SCMP_SYS(uname)};
#endif

// Libraries read system files on first use, which the filter would forbid.
void UseLibrariesOnce() {
  ::setenv("TZ", "UTC0", 1);  // times in a zip have no zone, and UTC needs no file
  ::tzset();
  (void)Sha256Hex("");
}

absl::Status EnterFolder(int folder) {
  if (::fchdir(folder) != 0) return HostError("can't enter the unpacking folder");
  if (::chroot(".") == 0) return absl::OkStatus();
  if (errno == EPERM && !EnterUserNamespace()) {
    return HostError("unpacking needs root or a user namespace, and this host allows neither");
  }
  return ::chroot(".") == 0 ? absl::OkStatus()
                            : HostError("can't make the unpacking folder the root");
}

absl::Status DropRights() {
  __user_cap_header_struct header = {_LINUX_CAPABILITY_VERSION_3, 0};
  const std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> none = {};
  if (::syscall(SYS_capset, &header, none.data()) != 0 ||
      ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
    return HostError("can't drop capabilities");
  }
  return absl::OkStatus();
}

absl::Status LoadFilter() {
  const std::unique_ptr<void, void (*)(void*)> filter(seccomp_init(SCMP_ACT_KILL_PROCESS),
                                                      seccomp_release);
  if (filter == nullptr) return absl::InternalError("libseccomp can't allocate a filter");
  int result = seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS);
  const auto allow = [&](int call, auto... conditions) {
    result |= seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, call, sizeof...(conditions),
                               conditions...);
  };
  for (const int call : kAllowed) allow(call);
  // Unpacking never needs executable memory.
  for (const int call : {SCMP_SYS(mmap), SCMP_SYS(mprotect)}) {
    allow(call, SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0));
  }
  // Sets the time of an open file only, never by name.
  allow(SCMP_SYS(utimensat), SCMP_A1(SCMP_CMP_EQ, 0));
  // abort() sends a signal to itself.
  allow(SCMP_SYS(tgkill), SCMP_A0(SCMP_CMP_EQ, static_cast<uint64_t>(::getpid())));
#if defined(__SANITIZE_ADDRESS__)
  for (const int call : kSanitizerCalls) allow(call);
#endif
  if (result != 0) {
    return absl::InternalError("libseccomp refuses a rule of the unpacking filter");
  }
  if (const int error = seccomp_load(filter.get()); error != 0) {
    errno = -error;
    return HostError("the kernel refuses the unpacking filter of system calls");
  }
  return absl::OkStatus();
}

// How much nicer than the daemon it is: many uploads must not starve the daemon's own threads.
constexpr int kNice = 10;
constexpr size_t kMaxAnswer = 8 << 20;  // a manifest is at most 64 KiB

// --- in the unpack process ------------------------------------------------------

nlohmann::json AnswerOf(const absl::StatusOr<Artefact>& artefact) {
  if (!artefact.ok()) {
    return {{"code", artefact.status().raw_code()},
            {"message", std::string(artefact.status().message())}};
  }
  return {{"code", 0},
          {"digest", artefact->digest},
          {"bytes", artefact->bytes},
          {"files", artefact->files},
          {"manifest", ManifestToJson(artefact->manifest)}};
}

bool Limit(int resource, int64_t value, int64_t hard) {
  const rlimit both = {static_cast<rlim_t>(value), static_cast<rlim_t>(hard)};
  return ::setrlimit(static_cast<__rlimit_resource>(resource), &both) == 0;
}

absl::Status LimitThisProcess(int64_t memory_bytes, int64_t cpu_s, pid_t parent) {
  // Dies with the thread that waits for it, even if that had died before this line.
  bool done = ::prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
  if (::getppid() != parent) return absl::CancelledError(
      "nobody is waiting for the unpacking any longer");
  done = done && Limit(RLIMIT_CORE, 0, 0);
  // At the hard time limit the signal would be SIGKILL, as if from outside.
  done = done && Limit(RLIMIT_CPU, cpu_s, cpu_s + 10);
#if !defined(__SANITIZE_ADDRESS__)  // its shadow takes terabytes of addresses
  done = done && Limit(RLIMIT_AS, memory_bytes, memory_bytes);
#else
  (void)memory_bytes;
#endif
  return done ? absl::OkStatus() : HostError("can't limit the unpacking process");
}

absl::StatusOr<Artefact> UnpackLimited(const std::string& archive, const std::string& destination,
                                       const ArtefactLimits& limits, int64_t memory_bytes,
                                       int64_t cpu_s, pid_t parent) {
  RETURN_IF_ERROR(LimitThisProcess(memory_bytes, cpu_s, parent));
  const Utf8Names utf8_names;  // their table is a system file
  ASSIGN_OR_RETURN(const UnpackPlace place, OpenUnpackPlace(archive, destination));
  RETURN_IF_ERROR(ConfineUnpacking(place.folder.get()));
  try {
    return UnpackOpened(place.archive.get(), place.folder.get(), limits);
  } catch (const std::bad_alloc&) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the archive takes more than ", memory_bytes,
        " bytes of memory to unpack; pack it again with an ordinary tar or zip"));
  }
}

// --- in the caller ---------------------------------------------------------------

// Runs the unpack process; what it writes until it exits, and how it ended.
absl::StatusOr<ProgramEnd> RunUnpacking(std::vector<std::string> words,
                                        const UnpackBudget& budget) {
  absl::Status stop;
  const auto stopped = [&] { return !(stop = budget.go_on()).ok(); };
  absl::StatusOr<ProgramEnd> end = RunProgram({.program = "myograde-unpack",
                                               .words = std::move(words),
                                               .most_output = kMaxAnswer,
                                               .deadline = budget.time,
                                               .nice = kNice},
                                              stopped);
  RETURN_IF_ERROR(stop);
  if (end.ok()) return end;
  if (!absl::IsDeadlineExceeded(end.status())) return absl::InternalError(end.status().message());
  return absl::DeadlineExceededError(absl::StrCat("the archive could not be unpacked within ",
                                                  absl::FormatDuration(budget.time),
                                                  ", because the host is too busy; send it again"));
}

// Signals that a process causes itself. Any other comes from outside: a person, or a kernel out of
// memory.
constexpr std::array kOwnFaults = {SIGABRT, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP};

absl::StatusOr<Artefact> ArtefactOf(const ProgramEnd& end, const UnpackBudget& budget) {
  const int signal = std::max(end.exit_status - 128, 0);
  if (signal == SIGXCPU) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the archive takes more than ", absl::FormatDuration(budget.cpu),
        " of processor time to unpack; make it smaller"));
  }
  if (std::ranges::find(kOwnFaults, signal) != kOwnFaults.end()) {
    return absl::InvalidArgumentError(
        absl::StrCat("unpacking the archive was killed by signal ", signal,
                     "; pack it again with an ordinary tar or zip"));
  }
  if (signal != 0) {
    return absl::UnavailableError(absl::StrCat(
        "the unpacking process was killed from outside (signal ", signal, "); send it again"));
  }
  const absl::StatusOr<nlohmann::json> json = ParseJson(end.output, "unpacking");
  if (!json.ok()) return absl::InternalError("the unpacking process returned no answer");
  ConfigReader reader(*json, "unpacking");
  const auto code = static_cast<absl::StatusCode>(reader.Integer("code", 0, 16));
  if (code != absl::StatusCode::kOk) return absl::Status(code, reader.String("message"));
  Artefact artefact;
  artefact.digest = reader.String("digest");
  // By the same rules as policy.json: the process may not be what it was.
  ASSIGN_OR_RETURN(artefact.manifest, ParseManifest(reader.Object("manifest")));
  artefact.bytes = reader.Integer("bytes", 0, INT64_MAX);
  artefact.files = reader.Integer("files", 0, INT64_MAX);
  RETURN_IF_ERROR(reader.Finish());
  return artefact;
}

}  // namespace

absl::Status ConfineUnpacking(int folder) {
  UseLibrariesOnce();
  RETURN_IF_ERROR(EnterFolder(folder));
  RETURN_IF_ERROR(DropRights());
  return LoadFilter();
}

absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget) {
  const absl::StatusOr<ProgramEnd> end =
      RunUnpacking({archive, destination, absl::StrCat(limits.bytes),
                    absl::StrCat(limits.files), absl::StrCat(limits.depth),
                    absl::StrCat(limits.name_bytes), absl::StrCat(budget.memory_bytes),
                    absl::StrCat(absl::ToInt64Seconds(budget.cpu)), absl::StrCat(::getpid())},
                   budget);
  absl::StatusOr<Artefact> artefact = end.ok() ? ArtefactOf(*end, budget) : end.status();
  if (!artefact.ok()) {
    std::error_code ignored;  // the first error is the one to report
    std::filesystem::remove_all(destination, ignored);
  }
  return artefact;
}

int RunUnpackProcess(int argc, char** argv) {
  std::array<int64_t, 7> numbers = {};
  bool good = argc == 3 + std::ssize(numbers);
  for (size_t i = 0; good && i < numbers.size(); ++i) {
    good = absl::SimpleAtoi(argv[3 + i], &numbers[i]);
  }
  if (!good) {
    std::fputs("error: only myograded runs myograde-unpack; submit with \"myograde submit\"\n",
               stderr);
    return 2;
  }
  const ArtefactLimits limits = {numbers[0], numbers[1], numbers[2], numbers[3]};
  const absl::StatusOr<Artefact> artefact =
      UnpackLimited(argv[1], argv[2], limits, numbers[4], numbers[5],
                    static_cast<pid_t>(numbers[6]));
  (void)WriteAll(STDOUT_FILENO, CanonicalJson(AnswerOf(artefact)));
  // No exit handlers: the filter does not allow what they might call.
  ::_exit(0);
}

}  // namespace myograde::server
