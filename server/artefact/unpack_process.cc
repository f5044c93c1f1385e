#include "server/artefact/unpack_process.h"

#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <new>
#include <utility>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/confine_unpack.h"
#include "server/artefact/listing.h"
#include "server/base/child_process.h"

namespace myograde::server {
namespace {

constexpr char kVerb[] = "unpack-one-archive";
// How much nicer than the daemon it is: many uploads must not starve the daemon's own threads.
constexpr int kNice = 10;
constexpr size_t kMaxAnswer = 8 << 20;  // a manifest is at most 64 KiB

// --- in the unpack process ------------------------------------------------------

nlohmann::json AnswerOf(const absl::StatusOr<Artefact>& artefact) {
  if (!artefact.ok()) {
    return {{"code", artefact.status().raw_code()},
            {"message", std::string(artefact.status().message())}};
  }
  nlohmann::json answer = {
      {"code", 0},
      {"digest", artefact->digest},
      {"name", artefact->manifest.name},
      {"command", artefact->manifest.command},
      {"runtimes", artefact->manifest.runtimes},
      {"environment", artefact->manifest.environment},
      {"adapter", artefact->manifest.adapter},
      {"extra_observations", artefact->manifest.extra_observations},
      {"bytes", artefact->bytes},
      {"files", artefact->files}};
  if (artefact->manifest.image.has_value()) {
    answer["image"] = PolicyImageToJson(*artefact->manifest.image);
  }
  return answer;
}

bool Limit(int resource, int64_t value, int64_t hard) {
  const rlimit both = {static_cast<rlim_t>(value), static_cast<rlim_t>(hard)};
  return ::setrlimit(static_cast<__rlimit_resource>(resource), &both) == 0;
}

absl::Status LimitThisProcess(int64_t memory_bytes, int64_t cpu_s, pid_t parent) {
  // Dies with the thread that waits for it, even if that had died before this line.
  bool done = ::prctl(PR_SET_PDEATHSIG, SIGKILL) == 0;
  if (::getppid() != parent) return absl::CancelledError("nobody waits for the unpacking any more");
  done = done && Limit(RLIMIT_CORE, 0, 0);
  // At the hard time limit the signal would be SIGKILL, as if from outside.
  done = done && Limit(RLIMIT_CPU, cpu_s, cpu_s + 10);
#if !defined(__SANITIZE_ADDRESS__)  // its shadow takes terabytes of addresses
  done = done && Limit(RLIMIT_AS, memory_bytes, memory_bytes);
#else
  (void)memory_bytes;
#endif
  return done ? absl::OkStatus() : HostError("the process for unpacking can't be limited");
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

// The small program beside the running one, which starts four times as fast; without it the running
// one, even if its file has been replaced since.
std::string UnpackProgram() {
  std::error_code error;
  const std::filesystem::path running = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string small = running.parent_path() / "myograde-unpack";
  return !error && ::access(small.c_str(), X_OK) == 0 ? small : "/proc/self/exe";
}

// Runs the unpack process; what it writes until it exits, and how it ended.
absl::StatusOr<ProgramEnd> RunUnpacking(std::vector<std::string> words,
                                        const UnpackBudget& budget) {
  absl::Status stop;
  absl::StatusOr<ProgramEnd> end = RunProgram({.program = UnpackProgram(),
                                               .words = std::move(words),
                                               .most_output = kMaxAnswer,
                                               .deadline = budget.time,
                                               .nice = kNice},
                                              [&] {
                                                stop = budget.go_on();
                                                return !stop.ok();
                                              });
  RETURN_IF_ERROR(stop);
  if (end.ok()) return end;
  if (!absl::IsDeadlineExceeded(end.status())) return absl::InternalError(end.status().message());
  return absl::DeadlineExceededError(absl::StrCat("the archive could not be unpacked within ",
                                                  absl::FormatDuration(budget.time),
                                                  ", as the host is too busy; send it again"));
}

// Signals that a process causes itself. Any other comes from outside: a person, or a kernel out of
// memory.
bool IsOwnFault(int signal) {
  for (const int own : {SIGABRT, SIGFPE, SIGILL, SIGSEGV, SIGSYS, SIGTRAP}) {
    if (signal == own) return true;
  }
  return false;
}

absl::StatusOr<Artefact> ArtefactOf(const ProgramEnd& end, const UnpackBudget& budget) {
  const int signal = std::max(end.exit_status - 128, 0);
  if (signal == SIGXCPU) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the archive takes more than ", absl::FormatDuration(budget.cpu),
        " of processor time to unpack; make it smaller"));
  }
  if (IsOwnFault(signal)) {
    return absl::InvalidArgumentError(
        absl::StrCat("unpacking the archive was ended by signal ", signal,
                     "; pack it again with an ordinary tar or zip"));
  }
  if (signal != 0) {
    return absl::UnavailableError(absl::StrCat(
        "what unpacked the archive was ended from outside (signal ", signal, "); send it again"));
  }
  const absl::StatusOr<nlohmann::json> json = ParseJson(end.output, "unpacking");
  if (!json.ok()) return absl::InternalError("the process for unpacking gave no answer");
  ConfigReader reader(*json, "unpacking");
  const auto code = static_cast<absl::StatusCode>(reader.Integer("code", 0, 16));
  if (code != absl::StatusCode::kOk) return absl::Status(code, reader.String("message"));
  Artefact artefact;
  artefact.digest = reader.String("digest");
  artefact.manifest.name = reader.String("name");
  artefact.manifest.command = reader.Strings("command");
  artefact.manifest.runtimes = reader.Strings("runtimes");
  artefact.manifest.environment = reader.StringsByName("environment");
  artefact.manifest.adapter = reader.String("adapter");
  artefact.manifest.extra_observations = reader.Boolean("extra_observations");
  artefact.bytes = reader.Integer("bytes", 0, INT64_MAX);
  artefact.files = reader.Integer("files", 0, INT64_MAX);
  if (reader.Has("image")) {
    ASSIGN_OR_RETURN(artefact.manifest.image,
                     PolicyImageFromJson(reader.Object("image"), "unpacking: image"));
  }
  RETURN_IF_ERROR(reader.Finish());
  return artefact;
}

}  // namespace

absl::StatusOr<Artefact> UnpackInProcess(const std::string& archive, const std::string& destination,
                                         const ArtefactLimits& limits, const UnpackBudget& budget) {
  if (budget.time <= absl::ZeroDuration() || budget.memory_bytes < 1 ||
      budget.cpu < absl::Seconds(1)) {
    return absl::FailedPreconditionError("every budget of unpacking must be above 0");
  }
  const absl::StatusOr<ProgramEnd> end =
      RunUnpacking({kVerb, archive, destination, absl::StrCat(limits.bytes),
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

bool RunUnpackProcess(int argc, char** argv, int& status) {
  constexpr int kWords = 11;
  if (argc < 2 || std::strcmp(argv[1], kVerb) != 0) return false;
  std::array<int64_t, 7> numbers = {};
  bool good = argc == kWords;
  for (size_t i = 0; good && i < numbers.size(); ++i) {
    good = absl::SimpleAtoi(argv[4 + i], &numbers[i]);
  }
  status = good ? 0 : 2;
  if (!good) return true;
  const ArtefactLimits limits = {numbers[0], numbers[1], numbers[2], numbers[3]};
  const absl::StatusOr<Artefact> artefact =
      UnpackLimited(argv[2], argv[3], limits, numbers[4], numbers[5],
                    static_cast<pid_t>(numbers[6]));
  (void)WriteAll(STDOUT_FILENO, CanonicalJson(AnswerOf(artefact)));
  // No exit handlers: the filter does not allow what they might call.
  ::_exit(0);
}

}  // namespace myograde::server
