#include "server/sandbox/adapter_command.h"

#include <filesystem>

#include <absl/strings/str_cat.h>

#include "server/sandbox/image_sandbox.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";

}  // namespace

std::string AdapterFolder(const std::string& adapter, const std::string& bin_dir) {
  const std::filesystem::path installed =
      std::filesystem::path(bin_dir).parent_path() / "share/myograde/adapters" / adapter;
  std::error_code error;
  if (std::filesystem::is_directory(installed, error)) return installed.string();
  return (std::filesystem::path(bin_dir).parent_path() / "adapters" / adapter).string();
}

std::vector<std::string> AdapterCommand(const LeaseOrder& order) {
  // Isolated: no variable and no file of the participant decides what the adapter imports.
  std::vector<std::string> command = order.image.has_value()
                                         ? HostCommand(kPython)
                                         : std::vector<std::string>{kPython};
  command.insert(command.end(),
                 {"-I", kAdapterPlace, "--track", std::string(order.track.kind->name)});
  if (order.image.has_value()) {
    command.insert(command.end(), {"--image", "--cwd", order.image->working_dir});
  }
  for (const std::string& runtime : order.runtimes) {
    command.insert(command.end(), {"--runtime", runtime});
  }
  for (std::string& variable : AgentEnvironment(order)) {
    command.insert(command.end(), {"--env", std::move(variable)});
  }
  if (order.extra_observations) command.emplace_back("--extra-observations");
  command.emplace_back("--");
  command.insert(command.end(), order.command.begin(), order.command.end());
  return command;
}

}  // namespace myograde::server
