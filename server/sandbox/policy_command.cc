#include "server/sandbox/policy_command.h"

#include <unistd.h>

#include <cmath>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/sandbox/image_sandbox.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";

// The libraries that runtimes bring for their modules (server/runtime/README.md).
std::vector<std::string> LibraryFolders(const std::vector<std::string>& runtimes) {
  std::vector<std::string> folders;
  for (const std::string& runtime : runtimes) {
    const std::string folder = runtime + "/debian-lib";
    if (access(folder.c_str(), F_OK) == 0) folders.push_back(folder);
  }
  return folders;
}

// What a submission sets comes before what its runtimes need.
std::map<std::string, std::string> FolderEnvironment(const LeaseOrder& order) {
  std::map<std::string, std::string> environment = order.environment;
  const auto join = [&](const char* name, const std::vector<std::string>& folders) {
    std::string& value = environment[name];
    absl::StrAppend(&value, value.empty() ? "" : ":", absl::StrJoin(folders, ":"));
  };
  if (environment.contains("PYTHONPATH") && !order.runtimes.empty()) {
    join("PYTHONPATH", order.runtimes);
  }
  const std::vector<std::string> libraries = LibraryFolders(order.runtimes);
  if (!libraries.empty()) join("LD_LIBRARY_PATH", libraries);
  return environment;
}

// What the image sets, and policy.json over it.
std::map<std::string, std::string> ImageEnvironment(const LeaseOrder& order) {
  // Programs that ask for the user's name find it here if the image does not know its number.
  std::map<std::string, std::string> all = {{"USER", "policy"}, {"LOGNAME", "policy"}};
  for (const auto& [name, value] : order.image->environment) all[name] = value;
  for (const auto& [name, value] : order.environment) all[name] = value;
  return all;
}

// The variables of the policy's program that are not every policy's, as "NAME=value".
std::vector<std::string> PolicyEnvironment(const LeaseOrder& order) {
  std::vector<std::string> variables;
  for (const auto& [name, value] :
       order.image.has_value() ? ImageEnvironment(order) : FolderEnvironment(order)) {
    variables.push_back(absl::StrCat(name, "=", value));
  }
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

}  // namespace

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

}  // namespace myograde::server
