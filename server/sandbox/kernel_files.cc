#include "server/sandbox/kernel_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

using Kind = SandboxMount::Kind;

// Lines of the host's file that begin with `key`.
std::vector<std::string> HostLines(const std::string& path, const std::string& key) {
  std::vector<std::string> found;
  for (std::string& line : std::vector<std::string>(absl::StrSplit(ReadKernelFile(path), '\n'))) {
    if (absl::StartsWith(line, key)) found.push_back(std::move(line));
  }
  return found;
}

// The host's total, which sysinfo(2) tells as well, and the budget as what is left.
std::string Meminfo(int64_t memory_bytes) {
  int64_t total = 0;
  for (const std::string& line : HostLines("/proc/meminfo", "MemTotal:")) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ', absl::SkipEmpty());
    if (words.size() < 2 || !absl::SimpleAtoi(words[1], &total)) total = 0;
  }
  const int64_t left = std::min(total, memory_bytes / 1024);
  return absl::StrCat("MemTotal: ", total, " kB\nMemFree: ", left, " kB\nMemAvailable: ", left,
                      " kB\nBuffers: 0 kB\nCached: 0 kB\nActive: 0 kB\nInactive: 0 kB\nSwapTotal: 0 kB\n"
                      "SwapFree: 0 kB\nShmem: 0 kB\n");
}

// The host's processors and the time of its start, without counts.
std::string Stat() {
  std::string text;
  for (const std::string& line : HostLines("/proc/stat", "cpu")) {
    absl::StrAppend(&text, line.substr(0, line.find(' ')), " 0 0 0 0 0 0 0 0 0 0\n");
  }
  for (const std::string& line : HostLines("/proc/stat", "btime")) {
    absl::StrAppend(&text, "intr 0\nctxt 0\n", line, "\n");
  }
  return text + "processes 1\nprocs_running 1\nprocs_blocked 0\n";
}

std::string CopyOf(const std::string& name) { return ReadKernelFile("/proc/" + name); }

// Each with what needs it.
const std::map<std::string, std::function<std::string(int64_t)>>& ProcFiles() {
  static const std::map<std::string, std::function<std::string(int64_t)>> files = {
      // NumPy, OpenBLAS, torch and OpenMP choose code by the processor's features.
      {"cpuinfo", [](int64_t) { return CopyOf("cpuinfo"); }},
      // libmount and libselinux look for file systems.
      {"filesystems", [](int64_t) { return CopyOf("filesystems"); }},
      // psutil, uptime.
      {"loadavg", [](int64_t) { return std::string("0.00 0.00 0.00 1/1 1\n"); }},
      // psutil, Java, and others that size caches by it.
      {"meminfo", Meminfo},
      // The C library counts processors by it where there is no /sys.
      {"stat", [](int64_t) { return Stat(); }},
      // ps and the like, which expect two numbers.
      {"uptime", [](int64_t) { return std::string("0.00 0.00\n"); }},
      // What uname(2) tells as well.
      {"version", [](int64_t) { return CopyOf("version"); }}};
  return files;
}

// Constants of the kernel and of its settings: read by the C library (ngroups_max,
// overcommit_memory), allocators, libcap (cap_last_cap), Go (somaxconn) and Java.
const std::vector<std::string>& Settings() {
  static const std::vector<std::string> names = {
      "kernel/cap_last_cap", "kernel/ngroups_max", "kernel/osrelease",  "kernel/ostype",
      "kernel/pid_max",      "kernel/threads-max", "kernel/version",    "net/core/somaxconn",
      "vm/max_map_count",    "vm/overcommit_memory"};
  return names;
}

// Made anew for each reader, so it is the kernel's own.
constexpr char kUuid[] = "kernel/random/uuid";

bool IsProcess(const std::string& name) {
  return name.find_first_not_of("0123456789") == std::string::npos;
}

// The sandbox has no capability, so what others may not read it can't read.
bool IsReadable(const struct stat& info) {
  return (info.st_mode & S_IROTH) != 0 && (S_ISREG(info.st_mode) || S_ISDIR(info.st_mode));
}

absl::StatusOr<std::string> StageSettings(const Stage& stage) {
  for (const char* folder : {"", "/kernel", "/kernel/random", "/net", "/net/core", "/vm"}) {
    RETURN_IF_ERROR(stage.AddFolder(absl::StrCat("proc-sys", folder)).status());
  }
  std::vector<std::pair<std::string, std::string>> files = {{kUuid, ""}};
  for (const std::string& name : Settings()) {
    files.emplace_back(name, ReadKernelFile("/proc/sys/" + name));
  }
  std::string folder;
  for (const auto& [name, text] : files) {
    ASSIGN_OR_RETURN(std::string path, stage.AddFile("proc-sys/" + name, text));
    folder = path.substr(0, path.size() - name.size() - 1);
  }
  return folder;
}

}  // namespace

std::string ReadKernelFile(const std::string& path) { return ReadFile(path).value_or(""); }

bool WriteKernelFile(const std::string& path, const std::string& text) {
  const Fd file(open(path.c_str(), O_WRONLY | O_CLOEXEC));
  return file.valid() && write(file.get(), text.data(), text.size()) == std::ssize(text);
}

absl::StatusOr<std::vector<SandboxMount>> StageKernelFiles(const Stage& stage,
                                                           int64_t memory_bytes) {
  ASSIGN_OR_RETURN(std::string nothing, stage.AddFile("proc-nothing", ""));
  ASSIGN_OR_RETURN(std::string empty, stage.AddFolder("proc-empty"));
  ASSIGN_OR_RETURN(std::string settings, StageSettings(stage));
  std::vector<SandboxMount> mounts = {{Kind::kReadOnly, empty, "/dev/pts"},
                                      {Kind::kReadOnly, settings, "/proc/sys"},
                                      {Kind::kReadOnly, absl::StrCat("/proc/sys/", kUuid),
                                       absl::StrCat("/proc/sys/", kUuid)}};
  std::error_code error;
  for (auto it = fs::directory_iterator("/proc", error); it != fs::directory_iterator();
       it.increment(error)) {
    const std::string name = it->path().filename();
    struct stat info = {};
    if (IsProcess(name) || name == "sys" || ::lstat(it->path().c_str(), &info) != 0 ||
        !IsReadable(info)) {
      continue;
    }
    std::string source = S_ISDIR(info.st_mode) ? empty : nothing;
    if (const auto file = ProcFiles().find(name); file != ProcFiles().end()) {
      ASSIGN_OR_RETURN(source, stage.AddFile("proc-" + name, file->second(memory_bytes)));
    }
    mounts.push_back({Kind::kReadOnly, std::move(source), "/proc/" + name});
  }
  if (!error) return mounts;
  return absl::FailedPreconditionError(absl::StrCat("can't list /proc: ", error.message()));
}

bool HideNetworkCounters() {
  static const std::set<std::string> shown = {"dev",  "if_inet6", "igmp", "ipv6_route", "route",
                                              "tcp",  "tcp6",     "udp",  "udp6",       "unix"};
  bool hidden = true;
  std::error_code error;
  for (auto it = fs::directory_iterator("/proc/thread-self/net", error);
       it != fs::directory_iterator(); it.increment(error)) {
    if (shown.contains(it->path().filename())) continue;
    hidden = ::chmod(it->path().c_str(), 0) == 0 && hidden;
  }
  return hidden && !error;
}

}  // namespace myograde::server
