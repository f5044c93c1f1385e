#include "server/sandbox/kernel_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <optional>
#include <sstream>
#include <utility>

#include <absl/strings/ascii.h>
#include <absl/strings/escaping.h>
#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>
#include <absl/strings/strip.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

using Kind = SandboxMount::Kind;

// The host's total, which sysinfo(2) tells as well, and the budget as what is left.
std::string Meminfo(int64_t memory_bytes) {
  const int64_t total = KernelNumber(ReadKernelFile("/proc/meminfo"), "MemTotal:");
  const int64_t left = std::min(total, memory_bytes / 1024);
  return absl::StrCat("MemTotal: ", total, " kB\nMemFree: ", left, " kB\nMemAvailable: ", left,
                      " kB\nBuffers: 0 kB\nCached: 0 kB\nActive: 0 kB\nInactive: 0 kB\nSwapTotal: 0 kB\n"
                      "SwapFree: 0 kB\nShmem: 0 kB\n");
}

// The host's processors and the time of its start, without counts.
std::string Stat() {
  std::string text;
  for (const absl::string_view line : absl::StrSplit(ReadKernelFile("/proc/stat"), '\n')) {
    if (absl::StartsWith(line, "cpu")) {
      absl::StrAppend(&text, line.substr(0, line.find(' ')), " 0 0 0 0 0 0 0 0 0 0\n");
    } else if (absl::StartsWith(line, "btime")) {
      absl::StrAppend(&text, "intr 0\nctxt 0\n", line, "\n");
    }
  }
  return text + "processes 1\nprocs_running 1\nprocs_blocked 0\n";
}

// What a policy reads of the file of that name, for what needs it; nullopt: nothing.
std::optional<std::string> ProcFile(const std::string& name, int64_t memory_bytes) {
  // cpuinfo: NumPy, OpenBLAS, torch and OpenMP choose code by the processor's features.
  // filesystems: libmount and libselinux look for file systems.
  // version: what uname(2) tells as well.
  for (const char* copied : {"cpuinfo", "filesystems", "version"}) {
    if (name == copied) return ReadKernelFile("/proc/" + name);
  }
  // psutil, Java, and others that size caches by it.
  if (name == "meminfo") return Meminfo(memory_bytes);
  // The C library counts processors by it where there is no /sys.
  if (name == "stat") return Stat();
  // psutil, ps, uptime and the like, which expect numbers.
  if (name == "loadavg") return "0.00 0.00 0.00 1/1 1\n";
  if (name == "uptime") return "0.00 0.00\n";
  return std::nullopt;
}

// Constants of the kernel and of its settings: read by the C library (ngroups_max,
// overcommit_memory), allocators, libcap (cap_last_cap), Go (somaxconn) and Java.
constexpr const char* kSettings[] = {
    "kernel/cap_last_cap", "kernel/ngroups_max", "kernel/osrelease",  "kernel/ostype",
    "kernel/pid_max",      "kernel/threads-max", "kernel/version",    "net/core/somaxconn",
    "vm/max_map_count",    "vm/overcommit_memory"};

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
  for (const std::string name : kSettings) {
    RETURN_IF_ERROR(
        stage.AddFile("proc-sys/" + name, ReadKernelFile("/proc/sys/" + name)).status());
  }
  ASSIGN_OR_RETURN(const std::string uuid, stage.AddFile(absl::StrCat("proc-sys/", kUuid), ""));
  return uuid.substr(0, uuid.size() - std::strlen(kUuid) - 1);
}

// Spaces and the like are octal escapes in mountinfo.
std::string Unescaped(const std::string& text) {
  std::string plain;
  return absl::CUnescape(text, &plain) ? plain : text;
}

}  // namespace

std::string ReadKernelFile(const std::string& path) { return ReadFile(path).value_or(""); }

bool WriteKernelFile(const std::string& path, const std::string& text) {
  const Fd file(open(path.c_str(), O_WRONLY | O_CLOEXEC));
  return file.valid() && write(file.get(), text.data(), text.size()) == std::ssize(text);
}

std::string KernelValue(std::string_view text, std::string_view key) {
  for (absl::string_view line : absl::StrSplit(absl::string_view(text.data(), text.size()), '\n')) {
    if (absl::ConsumePrefix(&line, absl::string_view(key.data(), key.size()))) {
      return std::string(absl::StripAsciiWhitespace(line));
    }
  }
  return "";
}

int64_t KernelNumber(std::string_view text, std::string_view key, int64_t otherwise) {
  std::string value = KernelValue(text, key);
  value.resize(std::min(value.find_first_of(" \t"), value.size()));
  int64_t number = 0;
  return absl::SimpleAtoi(value, &number) ? number : otherwise;
}

int64_t KernelSetting(const std::string& name, int index) {
  std::istringstream file(ReadKernelFile("/proc/sys/" + name));
  int64_t value = 0;
  for (int i = 0; i <= index; ++i) {
    if (!(file >> value)) return 0;
  }
  return value;
}

// ID PARENT MAJOR:MINOR ROOT POINT OPTIONS TAGS... - TYPE SOURCE OPTIONS
std::vector<KernelMount> MountsIn(const std::string& mountinfo) {
  std::vector<KernelMount> mounts;
  for (const absl::string_view line : absl::StrSplit(mountinfo, '\n')) {
    const std::vector<std::string> halves = absl::StrSplit(line, absl::MaxSplits(" - ", 1));
    if (halves.size() != 2) continue;
    const std::vector<std::string> left = absl::StrSplit(halves[0], ' ');
    const std::vector<std::string> right = absl::StrSplit(halves[1], ' ');
    KernelMount mount;
    if (left.size() < 5 || right.size() < 3 || !absl::SimpleAtoi(left[0], &mount.id)) continue;
    mount.device = left[2];
    mount.root = Unescaped(left[3]);
    mount.point = Unescaped(left[4]);
    mount.type = right[0];
    mount.options = absl::StrSplit(right[2], ',');
    mounts.push_back(std::move(mount));
  }
  return mounts;
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
    if (const std::optional<std::string> text = ProcFile(name, memory_bytes); text.has_value()) {
      ASSIGN_OR_RETURN(source, stage.AddFile("proc-" + name, *text));
    }
    mounts.push_back({Kind::kReadOnly, std::move(source), "/proc/" + name});
  }
  if (!error) return mounts;
  return absl::FailedPreconditionError(absl::StrCat("can't list /proc: ", error.message()));
}

}  // namespace myograde::server
