#include "server/cli/client/offered_runtimes.h"

#include <algorithm>
#include <filesystem>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "server/artefact/artefact.h"
#include "server/cli/base/exit_status.h"

namespace myograde::server {

absl::StatusOr<std::vector<std::string>> OfferedRuntimes(const Client& client) {
  const absl::StatusOr<nlohmann::json> answer = client.Get("/v1/runtimes");
  if (!answer.ok()) return answer.status();
  std::vector<std::string> names;
  for (const nlohmann::json& runtime : answer->value("runtimes", nlohmann::json::array())) {
    names.push_back(runtime.value("runtime", ""));
  }
  return names;
}

std::string MissingRuntime(const std::vector<std::string>& named,
                           const std::vector<std::string>& offered) {
  for (const std::string& name : named) {
    if (std::find(offered.begin(), offered.end(), name) != offered.end()) continue;
    return absl::StrCat("the server has no runtime \"", name, "\"; it has ",
                        offered.empty() ? "none" : absl::StrJoin(offered, ", "));
  }
  return "";
}

absl::Status CheckRuntimesOffered(const Client& client, const std::string& path) {
  std::error_code error;
  if (!std::filesystem::is_directory(path, error)) return absl::OkStatus();
  const absl::StatusOr<ArtefactManifest> manifest = ReadManifest(path);
  if (!manifest.ok()) return HostStatus(path, manifest.status());
  if (manifest->runtimes.empty()) return absl::OkStatus();
  const absl::StatusOr<std::vector<std::string>> offered = OfferedRuntimes(client);
  if (!offered.ok()) {
    // A server of an earlier version says it when the submission arrives.
    return AnsweredCode(offered.status()) == "not_found" ? absl::OkStatus() : offered.status();
  }
  const std::string missing = MissingRuntime(manifest->runtimes, *offered);
  if (missing.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": ", missing, "; name one of them in policy.json, or put what the policy "
                   "needs into the submission"));
}

}  // namespace myograde::server
