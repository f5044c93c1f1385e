#include "server/sandbox/policy_sandbox.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/pinned_maths.h"
#include "protocol/base/status_macros.h"
#include "protocol/policy/channels.h"
#include "server/base/paths.h"
#include "server/sandbox/kernel_files.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {
namespace {

using Kind = SandboxMount::Kind;

constexpr char kPrograms[] = "/myograde";
// Where a policy's sandbox shows the adapter of its order.
constexpr char kAdapterPlace[] = "/myograde/adapter";
// bubblewrap's two processes and the bridge, which are not the participant's.
constexpr int64_t kOwnTasks = 3;

#if defined(__SANITIZE_ADDRESS__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

// The host's files that every sandbox shows, but for images'.
void AddHostFiles(const EtcFiles& etc, SandboxSpec& spec) {
  const auto add = [&](Kind kind, std::string source, std::string target) {
    spec.mounts.push_back({kind, std::move(source), std::move(target)});
  };
  for (const std::string& link : SystemLinks()) {
    add(Kind::kSymlink, absl::StrCat("usr/", link), absl::StrCat("/", link));
  }
  spec.mounts.insert(spec.mounts.end(), etc.etc.begin(), etc.etc.end());
  for (const std::string& path : SystemPlaces()) add(Kind::kReadOnly, path, path);
}

// Identifies the sandbox' processes to the daemon; see slot_processes.h.
void AddMark(const LeaseOrder& order, const Stage& stage, SandboxSpec& spec) {
  if (order.slot_mark.empty()) return;
  spec.mounts.push_back({Kind::kReadOnly, stage.PathOf(order.slot_mark),
                         absl::StrCat(kPrograms, "/slot")});
}

// Must come last: what bubblewrap created itself is on a tmpfs of the sandbox' uid.
void Seal(SandboxSpec& spec) {
  spec.mounts.push_back({Kind::kSealed, "", "/dev"});
  spec.mounts.push_back({Kind::kSealed, "", "/"});
}

// Limits of every sandbox. A core limit of 0 would not stop the kernel from piping a dying process
// to the host's core dump program (core(5)); 1 does, and no file is that small.
void AddCommonLimits(SandboxSpec& spec) {
  spec.limits.insert(spec.limits.end(), {{RLIMIT_CORE, "core_bytes", 1},
                                         {RLIMIT_RTPRIO, "realtime_priority", 0},
                                         {RLIMIT_NICE, "nice", 0}});
}

void AddSanitizerOptions(SandboxSpec& spec) {
  // The leak check uses ptrace, which no sandbox allows.
  if (kSanitized) spec.environment.emplace_back("ASAN_OPTIONS", "detect_leaks=0");
}

// An order whose policy only says why the artefact can't be started, and ends. So it fails as any
// policy that ends before it says hello: what only a submission can cause is no fault of the grader.
LeaseOrder OrderThatSays(const LeaseOrder& order, absl::string_view why) {
  LeaseOrder says = order;
  says.image.reset();
  says.adapter.clear();
  says.environment.clear();
  says.command = {"/bin/sh", "-c", "printf '%s\\n' \"$0\" >&2; exit 126", std::string(why)};
  return says;
}

constexpr char kPython[] = "/usr/bin/python3";

// What a submission sets comes before what its runtimes need.
void AddRuntimes(const LeaseOrder& order, std::map<std::string, std::string>& environment) {
  const bool has_path = environment.contains("PYTHONPATH");
  const auto append = [&](const char* name, const std::string& folder) {
    std::string& value = environment[name];
    absl::StrAppend(&value, value.empty() ? "" : ":", folder);
  };
  for (const std::string& runtime : order.runtimes) {
    if (has_path) append("PYTHONPATH", runtime);
    // The libraries that it brings for its modules (server/runtime/README.md).
    const std::string libraries = runtime + "/debian-lib";
    if (access(libraries.c_str(), F_OK) == 0) append("LD_LIBRARY_PATH", libraries);
  }
}

// The variables of the policy's program that are not every policy's, as "NAME=value".
std::vector<std::string> PolicyEnvironment(const LeaseOrder& order) {
  std::map<std::string, std::string> all = order.environment;
  if (order.image.has_value()) {
    all.insert(order.image->environment.begin(), order.image->environment.end());
    // Programs that ask for the user's name find it here if the image does not know its number.
    all.insert({{"USER", "policy"}, {"LOGNAME", "policy"}});
  } else {
    AddRuntimes(order, all);
  }
  std::vector<std::string> variables;
  for (const auto& [name, value] : all) variables.push_back(absl::StrCat(name, "=", value));
  return variables;
}

// The adapter's command, which starts order.command with `variables` ("NAME=value") once it
// listens.
std::vector<std::string> AdapterCommand(const LeaseOrder& order,
                                        const std::vector<std::string>& variables) {
  // No variable and no file of the participant decides what the adapter imports. In an image Python
  // needs a variable that tells it where its library is, so it can't be wholly isolated there.
  std::vector<std::string> command;
  if (order.image.has_value()) {
    command = HostCommand(kPython);
    command.insert(command.end(), {"-P", "-s", "-S"});
  } else {
    command = {kPython, "-I"};
  }
  const auto add = [&](const std::string& option, const std::string& value) {
    command.insert(command.end(), {option, value});
  };
  command.emplace_back(kAdapterPlace);
  add("--name", order.adapter);
  add("--track", std::string(order.track.kind->name));
  for (const std::string& runtime : order.runtimes) add("--runtime", runtime);
  for (const std::string& variable : variables) add("--env", variable);
  if (order.image.has_value()) {
    add("--cwd", order.image->working_dir);
    command.emplace_back("--image");
  }
  if (order.extra_observations) command.emplace_back("--extra-observations");
  command.emplace_back("--");
  command.insert(command.end(), order.command.begin(), order.command.end());
  return command;
}

// The command of a policy's sandbox: the bridge at `bridge`, its place in the sandbox, which starts
// the participant's program, or an adapter (server/artefact/adapters.h) that does so. The policy's
// variables are set through it, so that none of them affects a program that is not the
// participant's.
std::vector<std::string> BridgeCommand(const LeaseOrder& order, const PolicySandboxConfig& config,
                                       const std::string& bridge) {
  const Budgets& budgets = order.track.budgets;
  const bool image = order.image.has_value();
  std::vector<std::string> command =
      image ? LoaderCommand(bridge, bridge) : std::vector<std::string>{bridge};
  const auto add = [&](const std::string& option, std::string value) {
    command.insert(command.end(), {option, std::move(value)});
  };
  add("--stray", std::to_string(budgets.stray_messages));
  add("--wrong", std::to_string(budgets.wrong_answers));
  if (const auto farewell = static_cast<int64_t>(std::lround(config.farewell_s * 1000));
      farewell > 0) {
    add("--farewell", std::to_string(farewell));
  }
  const std::vector<std::string> variables = PolicyEnvironment(order);
  std::vector<std::string> policy = order.command;
  if (order.adapter.empty()) {
    // An image's folder may be missing, which is not the sandbox' fault.
    if (image) add("--cwd", order.image->working_dir);
    for (const std::string& variable : variables) add("--env", variable);
  } else {
    if (image) add("--env", absl::StrCat("PYTHONHOME=", kHostPlace, "/usr"));
    policy = AdapterCommand(order, variables);
  }
  command.emplace_back("--");
  command.insert(command.end(), policy.begin(), policy.end());
  return command;
}

// Why the kernel would not start the command; "": nothing. Uploads have smaller bounds, artefacts
// of an import may not.
std::string TooLong(const std::vector<std::string>& command) {
  constexpr size_t kMostOfOne = 128 << 10;  // MAX_ARG_STRLEN of execve(2)
  constexpr size_t kMost = 1 << 20;         // leaves room for the sandbox' own
  size_t all = 0;
  for (const std::string& word : command) {
    if (word.size() >= kMostOfOne) {
      return absl::StrCat("an argument or variable of the policy has ", word.size(),
                          " bytes; at most ", kMostOfOne - 1, " can be passed to a program");
    }
    all += word.size() + 1;
  }
  if (all <= kMost) return "";
  return absl::StrCat("the policy's arguments and variables have ", all, " bytes; at most ", kMost,
                      " are passed");
}

}  // namespace

std::vector<std::string> PolicyPath(const std::vector<std::string>& runtimes) {
  std::vector<std::string> folders;
  for (const std::string& runtime : runtimes) folders.push_back(runtime + "/bin");
  folders.insert(folders.end(), {"/usr/local/bin", "/usr/bin", "/bin"});
  return folders;
}

std::vector<std::string> SystemPlaces() {
  std::vector<std::string> places = {"/usr"};
  // Linear algebra and other libraries are found through Debian's alternatives.
  for (const char* path : {"/etc/ld.so.cache", "/etc/alternatives", "/etc/localtime"}) {
    if (access(path, R_OK) == 0) places.emplace_back(path);
  }
  return places;
}

std::vector<std::string> SystemLinks() {
  std::vector<std::string> links;
  for (const char* link : {"bin", "sbin", "lib", "lib32", "lib64", "libx32"}) {
    if (access(absl::StrCat("/usr/", link).c_str(), F_OK) == 0) links.emplace_back(link);
  }
  return links;
}

absl::StatusOr<EtcFiles> StageEtcFiles(const LeaseOrder& order, const Stage& stage) {
  EtcFiles files;
  constexpr char kUsers[] =
      "root:x:0:0:root:/:/usr/sbin/nologin\npolicy:x:1000:1000::/tmp:/bin/sh\n";
  for (const auto& [name, text] :
       {std::pair("passwd", kUsers), std::pair("group", "root:x:0:\npolicy:x:1000:\n"),
        std::pair("hosts", kImageHosts)}) {
    ASSIGN_OR_RETURN(const std::string path, stage.AddFile(name, text));
    files.etc.push_back({Kind::kReadOnly, path, absl::StrCat("/etc/", name)});
  }
  ASSIGN_OR_RETURN(files.kernel, StageKernelFiles(stage, order.track.budgets.memory_bytes));
  return files;
}

std::vector<std::string> StagedSources(const LeaseOrder& order, const std::string& bin_dir) {
  std::vector<std::string> sources = {bin_dir, order.cache_dir};
  // An order that only replays logs has no artefact.
  if (order.replay.empty()) sources.push_back(order.artefact_dir);
  if (!order.slot_mark.empty()) sources.push_back(order.slot_mark);
  if (!order.adapter.empty()) sources.push_back(AdapterFolder(order.adapter, bin_dir));
  sources.insert(sources.end(), order.runtimes.begin(), order.runtimes.end());
  return sources;
}

absl::Status CheckOrderPaths(const LeaseOrder& order) {
  const auto absolute = [](const std::string& path) {
    return !path.empty() && path[0] == '/' && path.find("/../") == std::string::npos;
  };
  for (const std::string& path : StagedSources(order, "/")) {
    if (!absolute(path)) {
      return absl::InvalidArgumentError(
          absl::StrCat("the lease order names the folder \"", path, "\"; paths must be absolute"));
    }
  }
  std::vector<std::string> own = order.runtimes;
  own.push_back(order.cache_dir);
  for (const std::string& path : own) {
    for (const std::string taken : {"/", "/usr", "/etc", "/proc", "/dev", "/tmp", "/policy",
                                    kPrograms}) {
      const bool hides = path == taken || path == taken + "/" ||
                         (taken != "/" && taken != "/usr" && taken != "/tmp" &&
                          absl::StartsWith(path, taken + "/"));
      if (hides) {
        return absl::InvalidArgumentError(absl::StrCat(
            "the folder ", path, " can't be mounted in a sandbox at its own path, because ", taken,
            " has another meaning there; move it"));
      }
    }
  }
  return absl::OkStatus();
}

GroupLimits PolicyGroupLimits(const Budgets& budgets) {
  return {budgets.memory_bytes, budgets.tasks + kOwnTasks, budgets.cpus};
}

absl::StatusOr<SandboxSpec> MakePolicySandbox(const LeaseOrder& order,
                                              const PolicySandboxConfig& config,
                                              const std::string& bin_dir, const Stage& stage,
                                              const EtcFiles& etc, const std::string& scratch,
                                              const GroupControllers& group) {
  const Budgets& budgets = order.track.budgets;
  SandboxSpec spec;
  if (order.image.has_value()) {
    absl::Status added = AddImage(order, stage, spec);
    if (absl::IsInvalidArgument(added)) {
      return MakePolicySandbox(OrderThatSays(order, added.message()), config, bin_dir, stage, etc,
                               scratch, group);
    }
    if (!added.ok()) return added;
    spec.inner_uid = order.image->uid;
    spec.inner_gid = order.image->gid;
    spec.prlimit = HostCommand("/usr/bin/prlimit");
  } else {
    AddHostFiles(etc, spec);
  }
  spec.mounts.insert(spec.mounts.end(), {{Kind::kProc, "", "/proc"}, {Kind::kDev, "", "/dev"}});
  for (const auto& [name, path] : stage.devices()) {
    spec.mounts.push_back({Kind::kDevice, path, "/dev/" + name});
  }
  spec.mounts.insert(spec.mounts.end(), etc.kernel.begin(), etc.kernel.end());
  const std::string bridge = absl::StrCat(kPrograms, "/myograde-bridge");
  spec.mounts.push_back(
      {Kind::kReadOnly, stage.PathOf(bin_dir) + "/myograde-bridge", bridge});
  spec.mounts.push_back({Kind::kWritable, scratch + "/tmp", "/tmp"});
  spec.mounts.push_back({Kind::kWritable, scratch + "/shm", "/dev/shm"});
  for (const std::string& runtime : order.runtimes) {
    spec.mounts.push_back({Kind::kReadOnly, stage.PathOf(runtime), runtime});
  }
  if (!order.image.has_value()) {
    spec.mounts.push_back({Kind::kReadOnly, stage.PathOf(order.artefact_dir), "/policy"});
  }
  if (!order.adapter.empty()) {
    spec.mounts.push_back({Kind::kReadOnly,
                           stage.PathOf(AdapterFolder(order.adapter, bin_dir)), kAdapterPlace});
  }
  AddMark(order, stage, spec);
  Seal(spec);

  // A message wakes one process after the other on the slot's processor. If none preempts its waker
  // before that one sleeps, a step has a third fewer context switches.
  spec.batch = true;
  const std::string processors =
      std::to_string(std::max<int64_t>(1, static_cast<int64_t>(std::ceil(budgets.cpus))));
  const std::vector<std::string> path =
      order.image.has_value() ? ImagePath(*order.image) : PolicyPath(order.runtimes);
  spec.environment = {{"PATH", absl::StrJoin(path, ":")},
                      {"HOME", "/tmp"},
                      {"LANG", "C.UTF-8"},
                      {kBusUrlVariable, kBusUrl},
                      {"OMP_NUM_THREADS", processors},
                      {"PYTHONDONTWRITEBYTECODE", "1"},
                      // Output is not lost when it is killed, and string sets iterate in the same
                      // order in every run.
                      {"PYTHONUNBUFFERED", "1"},
                      {"PYTHONHASHSEED", "0"}};
  // An image's Python is another than the one that the runtimes are for.
  if (!order.runtimes.empty() && !order.image.has_value()) {
    spec.environment.emplace_back("PYTHONPATH", absl::StrJoin(order.runtimes, ":"));
  }
  AddSanitizerOptions(spec);
  spec.command = BridgeCommand(order, config, bridge);
  spec.working_dir = order.image.has_value() ? "/" : "/policy";
  if (const std::string why = TooLong(spec.command); !why.empty()) {
    return MakePolicySandbox(OrderThatSays(order, why), config, bin_dir, stage, etc, scratch, group);
  }
  spec.bus = true;
  spec.as_first = true;
  spec.held = true;
  spec.uid = order.uid;
  // Where a control group counts tasks, its count is the limit, as it also reports that it was
  // reached.
  spec.tasks = group.pids ? budgets.tasks + 64 : budgets.tasks + 1;
  spec.limits = {{RLIMIT_NOFILE, "open_files", budgets.open_files},
                 {RLIMIT_FSIZE, "file_bytes", budgets.scratch_bytes}};
  AddCommonLimits(spec);
  // AddressSanitizer reserves more address space than any budget.
  if (!group.memory && !kSanitized) {
    spec.limits.push_back({RLIMIT_AS, "address_space_bytes", budgets.memory_bytes});
  }
  return spec;
}

GroupLimits SimGroupLimits(const SimSandboxConfig& config) {
  return {config.memory_bytes, config.tasks, std::nullopt, /*background=*/false};
}

SandboxSpec MakeSimSandbox(const LeaseOrder& order, const SimSandboxConfig& config,
                           const std::string& bin_dir, const Stage& stage, const EtcFiles& etc) {
  SandboxSpec spec;
  AddHostFiles(etc, spec);
  spec.mounts.insert(spec.mounts.end(), {{Kind::kProc, "", "/proc"}, {Kind::kDev, "", "/dev"}});
  const std::string sim = absl::StrCat(kPrograms, "/myograde-sim");
  spec.mounts.push_back({Kind::kReadOnly, stage.PathOf(bin_dir) + "/myograde-sim", sim});
  spec.mounts.push_back({Kind::kReadOnly, stage.PathOf(order.cache_dir), order.cache_dir});
  AddMark(order, stage, spec);
  Seal(spec);
  spec.environment = {
      {"PATH", "/usr/bin:/bin"},
      {"LANG", "C.UTF-8"},
      {"LD_LIBRARY_PATH", order.cache_dir + "/mujoco-2.2.2/lib"},
      // The C library selects its maths routines by processor features; with these disabled all
      // hosts compute the same.
      {kTunablesVariable, kPinnedTunables}};
  AddSanitizerOptions(spec);
  spec.command = {sim, "--allow", absl::StrJoin(config.allowed_system_calls, ",")};
  spec.working_dir = "/";
  spec.uid = SimUser(order.uid);
  spec.tasks = config.tasks;
  spec.limits = {{RLIMIT_NOFILE, "open_files", config.open_files},
                 {RLIMIT_FSIZE, "file_bytes", 0}};
  AddCommonLimits(spec);
  if (!kSanitized) {
    spec.limits.push_back({RLIMIT_AS, "address_space_bytes", config.memory_bytes});
  }
  return spec;
}

}  // namespace myograde::server
