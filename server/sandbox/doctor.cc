#include "server/sandbox/doctor.h"

#include <fcntl.h>
#include <grp.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pwd.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/child_process.h"
#include "server/sandbox/control_group.h"
#include "server/sandbox/doctor_host.h"
#include "server/sandbox/policy_sandbox.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/sandbox_config.h"
#include "server/sandbox/slot_processes.h"
#include "server/sandbox/stage.h"

namespace myograde::server {
namespace {

constexpr absl::Duration kSandboxTime = absl::Seconds(30);

// How a child of ExamineHost ended, in words.
std::string Trouble(const ChildEnd& end) {
  if (!end.in_time && end.exit_code < 0 && end.output.empty()) return "no answer in time";
  // The cause, and what it led to.
  const std::string words = LastWords(end.output);
  if (!end.in_time) return absl::StrCat("no answer in time; last output: ", words);
  return words.empty() ? absl::StrCat("exit status ", end.exit_code) : words;
}

int64_t SandboxUid(const DoctorOptions& options) {
  return geteuid() == 0 ? options.uid_base + kDoctorUsers : -1;
}

// Bubblewrap creates its user namespace as the slot's user, so try as that user.
Check CheckUserNamespaces(const DoctorOptions& options) {
  const int64_t uid = SandboxUid(options);
  const ChildEnd end = RunInChild(
      [uid] {
        const auto id = static_cast<uid_t>(uid);
        if (uid >= 0 && (setgroups(0, nullptr) != 0 || setresgid(id, id, id) != 0 ||
                         setresuid(id, id, id) != 0)) {
          dprintf(STDERR_FILENO, "can't become uid %u: %s\n", id, std::strerror(errno));
          return 2;
        }
        return CanMakeUserNamespace() ? 0 : 1;
      },
      kQuick);
  const std::string who = uid >= 0 ? absl::StrCat("uid ", uid) : "this user";
  if (end.exit_code == 0) return Fine("user_namespaces", absl::StrCat("work for ", who));
  return Missing(
      "user_namespaces", end.exit_code == 1 ? absl::StrCat(who, " may create none") : Trouble(end),
      "no sandbox can be built, so nothing can be graded",
      "allow them with sysctl: user.max_user_namespaces above 0, and where present "
      "kernel.unprivileged_userns_clone=1 and kernel.apparmor_restrict_unprivileged_userns=0; "
      "in a container, start it privileged");
}

Check CheckBubblewrap() {
  const absl::StatusOr<ProgramEnd> end = RunProgram(
      {.program = kBubblewrap, .words = {"--version"}, .most_output = kMostPrinted, .deadline = kQuick});
  if (end.ok() && end->exit_status == 0) return Fine("bubblewrap", LastLineOf(end->output));
  return Missing("bubblewrap", WhyItFailed(end),
                 "no sandbox can be built, so nothing can be graded",
                 "install the package bubblewrap");
}

Check CheckSlotUsers(const DoctorOptions& options) {
  const char name[] = "slot_users";
  if (geteuid() != 0) {
    return Poorer(
        name, absl::StrCat("runs as the ordinary user with uid ", geteuid()),
        "all sandboxes run with this user's uid, so only namespaces separate leases from each "
        "other and from the user's files; without delegated control groups, policies are limited "
        "only by rlimits",
        "start the daemon as root: each slot then gets an unprivileged uid of its own");
  }
  for (int slot = 0; slot < options.slots; ++slot) {
    const auto uid = static_cast<uid_t>(options.uid_base + slot);
    const passwd* user = getpwuid(uid);
    if (user == nullptr) continue;
    return Poorer(name, absl::StrCat("uid ", uid, " of slot ", slot, " belongs to ", user->pw_name),
                  "a policy that got out of its namespaces would own that user's files",
                  "set uid_base in server.json to an unused range");
  }
  return Fine(name, absl::StrCat("uid ", options.uid_base, " to ",
                                 options.uid_base + options.slots - 1, ", one for each slot"));
}

void CheckControlGroups(const DoctorOptions& options, std::vector<Check>& checks) {
  (void)DivideDelegatedGroup();  // what it could not do, the checks below tell
  const GroupLimits limits = options.track.has_value() ? PolicyGroupLimits(options.track->budgets)
                                                       : GroupLimits{1 << 30, 64, 1};
  const GroupControllers got =
      ControlGroup::Create(GroupName("doctor"), limits)->controllers();
  const auto check = [&](const char* name, bool there, const char* costs) {
    checks.push_back(
        there ? Fine(name, absl::StrCat("control groups version ", got.version))
              : Poorer(name,
                       got.version == 0
                           ? "can't create a control group"
                           : absl::StrCat("not available with control groups version ",
                                          got.version),
                       costs,
                       "run as root, or as a service whose control groups systemd delegates "
                       "(Delegate=yes)"));
  };
  check("cgroup_memory", got.memory,
        "the memory limit applies to each process, not to all together; exceeding it is reported "
        "as a crash, and peak memory is not reported");
  check("cgroup_pids", got.pids,
        "processes are limited by RLIMIT_NPROC; reaching the limit is reported as a crash");
  check("cgroup_cpu", got.cpu, "a policy may use all processors, at the expense of other leases");
  check("cgroup_cpuacct", got.cpu_account,
        "CPU time is summed over the processes of a sandbox, which misses some short-lived ones");
}

// Loads the policy's filter into this process permanently. OK: it denies what it should.
absl::Status TryFilter(const std::string& config_dir) {
  ASSIGN_OR_RETURN(const SandboxConfig config, LoadSandboxConfig(config_dir));
  ASSIGN_OR_RETURN(const Fd filter, MakeSeccompFilter(config.policy));
  ASSIGN_OR_RETURN(const std::string bytes, ReadAll(filter.get(), "the filter"));
  std::vector<sock_filter> program(bytes.size() / sizeof(sock_filter));
  std::memcpy(program.data(), bytes.data(), bytes.size());
  const sock_fprog loaded = {static_cast<uint16_t>(program.size()), program.data()};
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
      syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, 0, &loaded) != 0) {
    return absl::InternalError(
        absl::StrCat("the kernel refuses the filter: ", std::strerror(errno)));
  }
  if (ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) == 0 || errno != EPERM) {
    return absl::InternalError("the filter is loaded but lets ptrace through");
  }
  return absl::OkStatus();
}

Check CheckSeccomp(const DoctorOptions& options) {
  const ChildEnd end = RunInChild([&] { return TrialExit(TryFilter(options.config_dir)); }, kQuick);
  if (end.exit_code == 0) return Fine("seccomp", "the policy's filter loads and denies");
  return Missing(
      "seccomp", Trouble(end), "no sandbox can be built",
      "use a kernel with CONFIG_SECCOMP_FILTER, and the sandbox/policy.json shipped with MyoGrade");
}

// Both sandboxes of a lease, as values.
struct Sandboxes {
  SandboxSpec policy;
  SandboxSpec simulator;
  SandboxConfig config;
  Budgets budgets;
  GroupControllers group;
  std::map<std::string, std::string> staged;  // staged path to host folder
};

// A lease whose artefact is the folder of this program. Missing folders are covered by another
// check.
LeaseOrder TrialOrder(const DoctorOptions& options) {
  std::error_code error;
  const std::string own = std::filesystem::read_symlink("/proc/self/exe", error);
  LeaseOrder order;
  order.lease = "doctor";
  order.artefact_dir = own.substr(0, own.rfind('/'));
  order.command = {"/policy" + own.substr(own.rfind('/')), "doctor", "--probe-bus"};
  order.track = *options.track;
  order.uid = SandboxUid(options);
  order.cache_dir =
      access(options.cache_dir.c_str(), R_OK | X_OK) == 0 ? options.cache_dir : options.bin_dir;
  for (const auto& [name, folder] : options.runtimes) {
    if (access(folder.c_str(), R_OK | X_OK) == 0) order.runtimes.push_back(folder);
  }
  return order;
}

// Moves this process into the runner's kind of mount namespace, builds both sandboxes there and
// passes them to `use` while that namespace lasts.
absl::Status WithSandboxes(const DoctorOptions& options,
                           const std::function<absl::Status(const Sandboxes&)>& use) {
  const LeaseOrder order = TrialOrder(options);
  RETURN_IF_ERROR(CheckOrderPaths(order));
  ASSIGN_OR_RETURN(SandboxConfig config, LoadSandboxConfig(options.config_dir));
  ASSIGN_OR_RETURN(Stage stage, Stage::Enter(StagedSources(order, options.bin_dir)));
  ASSIGN_OR_RETURN(EtcFiles etc, StageEtcFiles(order, stage));
  const Budgets& budgets = order.track.budgets;
  ASSIGN_OR_RETURN(std::string scratch,
                   stage.MountScratch(0, budgets.scratch_bytes, budgets.scratch_files));
  const GroupControllers group =
      ControlGroup::Create(GroupName("doctor"), PolicyGroupLimits(budgets))->controllers();
  std::map<std::string, std::string> staged;
  for (const std::string& source : StagedSources(order, options.bin_dir)) {
    staged[stage.PathOf(source)] = source;
  }
  ASSIGN_OR_RETURN(SandboxSpec policy, MakePolicySandbox(order, config.policy, options.bin_dir,
                                                         stage, etc, scratch, group));
  return use({std::move(policy), MakeSimSandbox(order, config.sim, options.bin_dir, stage, etc),
              config, budgets, group, staged});
}

// Runs WithSandboxes in a child, so that this process stays in its namespaces.
ChildEnd InSandboxChild(const DoctorOptions& options,
                        const std::function<absl::Status(const Sandboxes&)>& use) {
  ChildEnd end = RunInChild([&] { return TrialExit(WithSandboxes(options, use)); }, kSandboxTime);
  // A child that was killed at its deadline could not remove its own groups.
  if (!end.in_time) ControlGroup::RemoveStale();
  return end;
}

// Runs `spec` in a control group with this process' stdout and stderr, and expects it to succeed.
absl::Status Play(const SandboxSpec& spec, const PolicySandboxConfig& config,
                  const std::string& group_name) {
  ASSIGN_OR_RETURN(const Fd filter, MakeSeccompFilter(config));
  const auto group = ControlGroup::Create(GroupName(group_name), {1 << 30, 64, 1.0});
  const Fd nothing(open("/dev/null", O_RDONLY | O_CLOEXEC));
  ASSIGN_OR_RETURN(
      std::unique_ptr<Sandbox> sandbox,
      Sandbox::Start(spec, {{nothing.get(), 0}, {STDOUT_FILENO, 1}, {STDERR_FILENO, 2}},
                     group->join_fds(), filter));
  sandbox->Release();
  if (!sandbox->Wait(kSandboxTime - absl::Seconds(5))) {
    return absl::DeadlineExceededError("its command did not end");
  }
  const SandboxEnd end = sandbox->end();
  if (end.started && end.exit_code == 0) return absl::OkStatus();
  // Its own output says more, so the status values come after it.
  return absl::InternalError(end.started ? absl::StrCat("its command ended with ", end.exit_code)
                                         : "bubblewrap could not start its command");
}

// Plays in the sandboxes; `good`: what is found if that succeeds.
Check TrySandbox(const char* name, const DoctorOptions& options, const char* good,
                 const char* costs, const char* todo,
                 const std::function<absl::Status(const Sandboxes&)>& play) {
  if (!options.track.has_value()) {
    return Missing(name, "can't be tried without a track's budgets", "nothing can be graded",
                   "fix the configs first");
  }
  const ChildEnd end = InSandboxChild(options, play);
  return end.exit_code == 0 ? Fine(name, good) : Missing(name, Trouble(end), costs, todo);
}

Check CheckPolicySandbox(const DoctorOptions& options) {
  return TrySandbox(
      "policy_sandbox", options, "starts, and LCM's multicast works in its own network",
      "no policy can be started, so nothing can be graded",
      "fix what is missing above first; no sandbox can start in a plain chroot or an unprivileged "
      "container",
      [](const Sandboxes& sandboxes) {
        SandboxSpec spec = sandboxes.policy;
        // Skip the bridge, which waits for a simulator.
        const auto separator = std::find(spec.command.begin(), spec.command.end(), "--");
        spec.command.erase(spec.command.begin(), separator + 1);
        return Play(spec, sandboxes.config.policy, "doctor");
      });
}

Check CheckSimulatorSandbox(const DoctorOptions& options) {
  return TrySandbox("simulator_sandbox", options,
                    "starts; the simulator finds its libraries and sets its filter",
                    "no episode can be simulated, so nothing can be graded",
                    "fix what is missing elsewhere in this list first",
                    [](const Sandboxes& sandboxes) {
                      SandboxSpec spec = sandboxes.simulator;
                      // Loads its libraries, sets its own filter and exits.
                      spec.command.push_back("--try");
                      return Play(spec, sandboxes.config.policy, "doctor-sim");
                    });
}

// A control group's limits, null where none enforces them on this host.
nlohmann::json DescribeGroup(const GroupLimits& limits, const GroupControllers& got) {
  using Json = nlohmann::json;
  return {{"version", got.version},
          {"memory_bytes", got.memory ? Json(limits.memory_bytes) : Json()},
          {"tasks", got.pids ? Json(limits.tasks) : Json()},
          {"cpus", got.cpu && limits.cpus.has_value() ? Json(*limits.cpus) : Json()}};
}

nlohmann::json Describe(const Sandboxes& sandboxes) {
  const PolicySandboxConfig& calls = sandboxes.config.policy;
  nlohmann::json policy = SandboxSpecToJson(sandboxes.policy);
  policy["system_calls"] = {{"denied", calls.denied_system_calls},
                            {"unimplemented", calls.unimplemented_system_calls}};
  policy["control_group"] = DescribeGroup(PolicyGroupLimits(sandboxes.budgets), sandboxes.group);
  policy["scratch"] = {{"bytes", sandboxes.budgets.scratch_bytes},
                       {"files", sandboxes.budgets.scratch_files}};
  nlohmann::json simulator = SandboxSpecToJson(sandboxes.simulator);
  simulator["system_calls"] = policy["system_calls"];
  simulator["system_calls"]["allowed_once_loaded"] = sandboxes.config.sim.allowed_system_calls;
  simulator["control_group"] =
      DescribeGroup(SimGroupLimits(sandboxes.config.sim), sandboxes.group);
  // The doctor's own probe replaces a submission's command.
  std::vector<std::string> command = sandboxes.policy.command;
  command.erase(std::find(command.begin(), command.end(), "--") + 1, command.end());
  command.push_back("COMMAND");
  policy["command"] = command;
  return {{"policy", policy},
          {"simulator", simulator},
          {"staged", sandboxes.staged}};
}

}  // namespace

std::string_view CheckStateName(CheckState state) {
  constexpr std::string_view kNames[] = {"ok", "degraded", "missing"};
  return kNames[static_cast<int>(state)];
}

std::vector<Check> ExamineHost(const DoctorOptions& options) {
  std::vector<Check> checks;
  CheckHost(options, checks);
  checks.insert(checks.end(),
                {CheckBubblewrap(), CheckUserNamespaces(options), CheckSlotUsers(options)});
  CheckControlGroups(options, checks);
  CheckSharedLimits(options, checks);
  checks.insert(checks.end(),
                {CheckSeccomp(options), CheckPolicySandbox(options), CheckSimulatorSandbox(options),
                 CheckMujoco(options), CheckModels(options)});
  return checks;
}

absl::StatusOr<nlohmann::json> DescribeSandboxes(const DoctorOptions& options) {
  if (!options.track.has_value()) {
    return absl::InternalError("a sandbox needs a track's budgets, but no track can be read");
  }
  const ChildEnd end = InSandboxChild(options, [](const Sandboxes& sandboxes) {
    const std::string text = Describe(sandboxes).dump();
    if (write(STDOUT_FILENO, text.data(), text.size()) == std::ssize(text)) return absl::OkStatus();
    return absl::InternalError("the description is too long for a pipe");
  });
  nlohmann::json json = nlohmann::json::parse(end.output, nullptr, false);
  if (end.exit_code == 0 && json.is_object()) return json;
  return absl::InternalError(absl::StrCat("can't build a sandbox here: ", Trouble(end)));
}

}  // namespace myograde::server
