#include "server/sandbox/doctor_host.h"

#include <dlfcn.h>
#include <sys/statvfs.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <set>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_replace.h>
#include <absl/strings/strip.h>

#include "protocol/base/set_up.h"
#include "server/base/child_process.h"
#include "server/base/temp_folder.h"
#include "server/sandbox/kernel_files.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kNoSimulation[] = "no episode can be simulated, so nothing can be graded";
constexpr double kGiB = 1024.0 * 1024.0 * 1024.0;
// Compiling both models takes seconds, longer on a busy host.
constexpr absl::Duration kCompileTime = absl::Seconds(300);

std::string HowToSetUp() {
  return SetUpAdvice() + ", or pass the folder that it filled as --cache";
}

std::string FirstLine(const std::string& path) {
  const std::string text = ReadKernelFile(path);
  return text.substr(0, text.find('\n'));
}

// A value of /proc/cpuinfo; "" if it has none of that name.
std::string CpuValue(std::string_view name) {
  const std::string value = KernelValue(ReadKernelFile("/proc/cpuinfo"), name);
  return value.starts_with(": ") ? value.substr(2) : "";
}

// A value of /etc/os-release, without its quotes; "" if it has none of that name.
std::string SystemValue(std::string_view name) {
  const std::string value =
      KernelValue(ReadKernelFile("/etc/os-release"), absl::StrCat(std::string(name), "="));
  return std::string(absl::StripPrefix(absl::StripSuffix(value, "\""), "\""));
}

int64_t MemoryBytes(const char* key) {
  return KernelNumber(ReadKernelFile("/proc/meminfo"), key) * 1024;
}

std::string GiB(double bytes) { return absl::StrFormat("%.1f GiB", bytes / kGiB); }

std::set<std::string> CompiledModels(const std::string& cache_dir) {
  std::error_code error;
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(cache_dir + "/models", error)) {
    if (entry.path().extension() == ".mjb") names.insert(entry.path().filename().string());
  }
  return names;
}

// Physical cores: processors that are not another core's second thread; 0: unknown.
int Cores() {
  std::set<std::string> cores;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/devices/system/cpu", error)) {
    const std::string siblings =
        FirstLine((entry.path() / "topology/thread_siblings_list").string());
    if (!siblings.empty()) cores.insert(siblings);
  }
  return static_cast<int>(cores.size());
}

Check CheckProcessor() {
  const std::string flags = " " + CpuValue("flags") + " ";
  const std::string found = absl::StrCat(CpuValue("model name"), ", ",
                                         sysconf(_SC_NPROCESSORS_ONLN), " processors");
  if (absl::StrContains(flags, " avx ")) return Fine("processor", found);
  return Missing("processor", found + ", without AVX", "the upstream build of MuJoCo can't run",
                 "use an x86-64 processor with AVX, or build with -DMYOGRADE_MUJOCO=system");
}

Check CheckCores(const DoctorOptions& options) {
  const auto processors = static_cast<int>(sysconf(_SC_NPROCESSORS_ONLN));
  const int cores = Cores();
  const bool smt = FirstLine("/sys/devices/system/cpu/smt/active") == "1";
  const std::string threads = absl::StrCat("simultaneous multithreading ", smt ? "on" : "off",
                                           cores > 0 ? absl::StrCat(", ", cores, " cores") : "");
  if (smt && cores > 0 && options.slots > cores) {
    return Poorer("cores", threads,
                  absl::StrCat(options.slots, " slots share ", cores,
                               " cores: each lease runs slower; results stay the same"),
                  absl::StrCat("set slots in server.json to ", cores));
  }
  if (options.slots > processors) {
    return Poorer("cores", threads,
                  absl::StrCat(options.slots, " slots on ", processors,
                               " processors make whole evaluations slower"),
                  "set slots in server.json to \"cores\"");
  }
  return Fine("cores", threads);
}

Check CheckFrequency() {
  const std::string folder = "/sys/devices/system/cpu/";
  const std::string governor = FirstLine(folder + "cpu0/cpufreq/scaling_governor");
  const std::string no_turbo = FirstLine(folder + "intel_pstate/no_turbo");
  const std::string boost = FirstLine(folder + "cpufreq/boost");
  const std::string turbo = no_turbo == "0" || boost == "1"   ? "on"
                            : no_turbo == "1" || boost == "0" ? "off"
                                                              : "not reported by this host";
  const std::string found = absl::StrCat(
      "governor ", governor.empty() ? "not reported by this host" : governor, ", turbo ", turbo);
  if (governor == "powersave" && no_turbo.empty()) {
    return Poorer("frequency", found, "evaluations take longer; results stay the same",
                  "cpupower frequency-set -g performance");
  }
  return Fine("frequency", found);
}

Check CheckMemory(const DoctorOptions& options) {
  const auto total = static_cast<double>(MemoryBytes("MemTotal:"));
  const auto available = static_cast<double>(MemoryBytes("MemAvailable:"));
  const std::string found = absl::StrCat(GiB(total), ", ", GiB(available), " available");
  const auto policy = static_cast<double>(
      options.track.has_value() ? options.track->budgets.memory_bytes : 0);
  // A simulator stays far below a quarter of a GiB.
  const double wanted = options.slots * (policy + 0.25 * kGiB);
  if (total >= wanted) return Fine("memory", found);
  return Poorer(
      "memory", found,
      absl::StrCat(options.slots, " policies that use their whole budget of ", GiB(policy),
                   " at once don't fit; the kernel may then kill one below its limit, which the "
                   "participant sees as a crash"),
      "lower slots in server.json, or memory_bytes in the tracks' budgets");
}

// The folder itself, or its closest existing parent.
fs::path Existing(const std::string& folder) {
  fs::path path = folder;
  std::error_code error;
  while (!fs::exists(path, error) && path.has_relative_path()) path = path.parent_path();
  return path;
}

Check CheckDisk(const char* name, const std::string& folder, double wanted, bool written,
                double reserve) {
  const fs::path path = Existing(folder);
  struct statvfs space;
  if (statvfs(path.c_str(), &space) != 0 || (written && access(path.c_str(), W_OK | X_OK) != 0)) {
    return Missing(
        name, absl::StrCat(folder, ": ", std::strerror(errno)),
        written ? "this user can't start a daemon" : "nothing can be installed there",
        "choose a folder that this user may write to");
  }
  const double free = static_cast<double>(space.f_bavail) * static_cast<double>(space.f_frsize);
  const std::string found = absl::StrCat(GiB(free), " free in ", path.string(),
                                         path == folder ? "" : absl::StrCat(" (for ", folder, ")"));
  if (free < reserve) {
    return Missing(name, found, "uploads are refused, and no lease can start",
                   absl::StrCat("make ", GiB(std::max(wanted, reserve)),
                                " free (disk_reserve_bytes is ", GiB(reserve), ")"));
  }
  if (free >= wanted) return Fine(name, found);
  return Poorer(
      name, found,
      written ? "large submissions, or many, will be refused" : "a fresh set-up may not fit",
      absl::StrCat("make ", GiB(wanted), " free, or choose another folder"));
}

Check CheckPython() {
  const absl::StatusOr<ProgramEnd> python = RunProgram({.program = "/usr/bin/python3",
                                                        .words = {"--version"},
                                                        .most_output = kMostPrinted,
                                                        .deadline = kQuick,
                                                        .environment = {"PATH=/usr/bin:/bin"}});
  if (python.ok() && python->exit_status == 0) {
    return Fine("python", "/usr/bin/python3: " + LastLineOf(python->output));
  }
  return Poorer("python", WhyItFailed(python), "policies in Python can't run",
                "install the package python3");
}

Check CheckRuntime(const DoctorOptions& options, const std::string& name,
                   const std::string& folder) {
  const std::string check = "runtime_" + name;
  if (access(folder.c_str(), R_OK | X_OK) != 0) {
    return Poorer(check, absl::StrCat(folder, ": ", std::strerror(errno)),
                  "submissions that ask for this runtime are refused",
                  SetUpAdvice() + ", or fix runtimes in server.json");
  }
  const absl::Status same =
      options.check_runtime == nullptr ? absl::OkStatus() : options.check_runtime(name);
  if (same.ok()) return Fine(check, folder);
  return Poorer(
      check, std::string(same.message()),
      "policies with this runtime run with other packages than their receipts state",
      absl::StrCat("build it again: myograde runtime add ", name, " REQUIREMENTS --replace"));
}

Check CheckSystem() {
  const std::string system = SystemValue("PRETTY_NAME");
  if (SystemValue("ID") == "debian" && SystemValue("VERSION_ID") == "12") {
    return Fine("system", absl::StrCat(system, " ", FirstLine("/etc/debian_version")));
  }
  return Poorer("system", system.empty() ? "unknown" : system,
                "MyoGrade is tested on Debian 12 only", "use Debian 12");
}

Check CheckKernel() {
  utsname kernel;
  uname(&kernel);
  int major = 0;
  int minor = 0;
  std::sscanf(kernel.release, "%d.%d", &major, &minor);
  if (major > 5 || (major == 5 && minor >= 9)) return Fine("kernel", kernel.release);
  return Missing("kernel", kernel.release, "the sandboxes use system calls that it lacks",
                 "use Linux 5.9 or newer");
}

Check CheckPrograms(const DoctorOptions& options) {
  std::string absent;
  for (const char* program : {"myograded", "myograde-runner", "myograde-sim", "myograde-bridge",
                              "myograde-unpack"}) {
    if (access(absl::StrCat(options.bin_dir, "/", program).c_str(), X_OK) != 0) {
      absl::StrAppend(&absent, absent.empty() ? "" : ", ", program);
    }
  }
  if (absent.empty()) return Fine("programs", "all in " + options.bin_dir);
  return Missing("programs", absl::StrCat("not in ", options.bin_dir, ": ", absent),
                 "nothing can be graded",
                 absl::StrCat(IsInstalled(options.bin_dir + "/myograded")
                                  ? "install the package myograde-server"
                                  : "run ./dev build",
                              ", or set MYOGRADE_BIN_DIR to their folder"));
}

Check CheckPictures() {
  // In a child: it brings a compiler along.
  const bool draws =
      RunInChild([] { return dlopen("libOSMesa.so.8", RTLD_LAZY) == nullptr ? 1 : 0; }, kQuick)
          .exit_code == 0;
  const absl::StatusOr<std::string> encoder = FindProgram("ffmpeg");
  if (draws && encoder.ok()) {
    return Fine("pictures", "libOSMesa.so.8 draws, and " + *encoder + " encodes films");
  }
  std::string install = draws ? "" : " libosmesa6";
  if (!encoder.ok()) install += " ffmpeg";
  const std::string no_library =
      absl::StrCat("libOSMesa.so.8 is missing", encoder.ok() ? "" : ", and so is ffmpeg");
  return Poorer(
      "pictures", draws ? "ffmpeg is missing" : no_library,
      draws ? "render draws pictures but no films"
            : "neither render nor the pages draw pictures of episodes; grading needs none",
      "apt-get install" + install);
}

Check CheckFigures() {
  const absl::StatusOr<ProgramEnd> python =
      RunProgram({.program = "/usr/bin/python3",
                  .words = {"-I", "-c", "import matplotlib; print(matplotlib.__version__)"},
                  .most_output = kMostPrinted,
                  .deadline = kQuick,
                  .environment = {"PATH=/usr/bin:/bin"}});
  if (python.ok() && python->exit_status == 0) {
    return Fine("figures", "matplotlib " + LastLineOf(python->output) + " draws figures and reports");
  }
  return Poorer("figures", WhyItFailed(python),
                "plot and report draw nothing; their numbers can be had with --json",
                "apt-get install python3-matplotlib");
}

}  // namespace

Check CheckMujoco(const DoctorOptions& options) {
  const std::string library = options.cache_dir + "/mujoco-2.2.2/lib/libmujoco.so.2.2.2";
  if (access(library.c_str(), R_OK) == 0) return Fine("mujoco", library);
  return Missing("mujoco", absl::StrCat(library, ": ", std::strerror(errno)), kNoSimulation,
                 HowToSetUp());
}

Check CheckModels(const DoctorOptions& options) {
  const char name[] = "models";
  // Compiled from a copy of the models' sources, a link, so that the cache stays as it is.
  const absl::StatusOr<TempFolder> scratch = TempFolder::Make("doctor");
  if (!scratch.ok()) {
    return Missing(name, absl::StrCat("can't be tried: ", std::string(scratch.status().message())),
                   kNoSimulation, "set TMPDIR to a folder with 1 GiB of space");
  }
  std::error_code error;
  fs::create_directory_symlink(options.cache_dir + "/myosuite-2.8.4",
                               scratch->path() + "/myosuite-2.8.4", error);
  const absl::StatusOr<ProgramEnd> end =
      RunProgram({.program = options.bin_dir + "/myograde-sim",
                  .words = {"--compile-models", scratch->path()},
                  .most_output = kMostPrinted,
                  .deadline = kCompileTime,
                  .nice = 0,
                  .environment = {"PATH=/usr/bin:/bin",
                                  "LD_LIBRARY_PATH=" + options.cache_dir + "/mujoco-2.2.2/lib"}});
  if (!end.ok() || end->exit_status != 0) {
    return Missing(name,
                   absl::StrReplaceAll(WhyItFailed(end), {{scratch->path(), options.cache_dir}}),
                   kNoSimulation, HowToSetUp());
  }
  const std::string found = "every source file has its SHA-256, and every track's model compiles";
  std::set<std::string> lacking = CompiledModels(scratch->path());
  for (const std::string& model : CompiledModels(options.cache_dir)) lacking.erase(model);
  if (lacking.empty()) return Fine(name, found);
  return Poorer(name,
                absl::StrCat(found, "; ", options.cache_dir, "/models lacks ",
                             absl::StrJoin(lacking, ", ")),
                "each lease compiles its model, which takes about a second",
                absl::StrCat("myograde-sim --compile-models ", options.cache_dir));
}

void CheckHost(const DoctorOptions& options, std::vector<Check>& checks) {
  checks.insert(checks.end(), {CheckSystem(), CheckKernel(), CheckPython()});
  for (const auto& [name, folder] : options.runtimes) {
    checks.push_back(CheckRuntime(options, name, folder));
  }
  checks.insert(checks.end(), {CheckProcessor(), CheckCores(options), CheckFrequency(),
                               CheckMessages(), CheckMemory(options),
                               CheckDisk("disk_data", options.data_dir,
                                         2.0 * static_cast<double>(options.submission_bytes), true,
                                         static_cast<double>(options.disk_reserve)),
                               CheckDisk("disk_cache", options.cache_dir, kGiB, false, 0),
                               CheckPrograms(options), CheckPictures(), CheckFigures()});
}

}  // namespace myograde::server
