#include "server/cli/client/offered_runtimes.h"

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/status_macros.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client) {
  ASSIGN_OR_RETURN(const nlohmann::json answer, client.Get("/v1/runtimes"));
  std::vector<std::string> names;
  for (const nlohmann::json& runtime : answer.value("runtimes", nlohmann::json::array())) {
    names.push_back(runtime.value("runtime", ""));
  }
  return names;
}

std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered) {
  for (const std::string& name : named) {
    if (std::find(offered.begin(), offered.end(), name) != offered.end()) continue;
    return absl::StrCat("policy.json asks for the runtime \"", Harmless(name),
                        "\", which this server does not have; it has ",
                        offered.empty() ? "none" : Harmless(absl::StrJoin(offered, ", ")));
  }
  return "";
}

}  // namespace myograde::server
