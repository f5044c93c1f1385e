#include "server/sandbox/adapter_command.h"

#include <absl/strings/str_cat.h>

#include "server/sandbox/image_sandbox.h"

namespace myograde::server {
namespace {

constexpr char kPython[] = "/usr/bin/python3";

}  // namespace

std::vector<std::string> AdapterEnvironment(const LeaseOrder& order) {
  if (!order.image.has_value()) return {};
  return {absl::StrCat("PYTHONHOME=", kHostPlace, "/usr")};
}

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
  add(kAdapterPlace, "--track");
  command.emplace_back(order.track.kind->name);
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

}  // namespace myograde::server
