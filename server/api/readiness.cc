#include "server/api/readiness.h"

#include <unistd.h>

#include <absl/strings/str_cat.h>

#include "server/base/paths.h"
#include "server/http/http_server.h"
#include "server/metrics/disk_space.h"

namespace myograde::server {
namespace {

// What a lease needs of this installation, beside the models, whose lack the self-test finds.
constexpr const char* kPrograms[] = {"myograde-runner", "myograde-sim", "myograde-bridge"};

// "" if every program is there.
std::string MissingProgram() {
  const absl::StatusOr<std::string> folder = BinDir();
  if (!folder.ok()) return std::string(folder.status().message());
  for (const char* program : kPrograms) {
    const std::string path = absl::StrCat(*folder, "/", program);
    if (access(path.c_str(), X_OK) != 0) {
      return absl::StrCat(path, " is missing or not executable; install MyoGrade again");
    }
  }
  return "";
}

}  // namespace

std::vector<Obstacle> FindObstacles(const ApiContext& context, const LiveHealth& health) {
  const auto closed = static_cast<int>(health.closed_slots.size());
  std::string slots;
  if (closed >= context.config.scheduler.slots) {
    slots = absl::StrCat("all ", closed, " slots are closed until processes on them are gone, ",
                         "on slot ", health.closed_slots.begin()->first, " ",
                         health.closed_slots.begin()->second);
  }
  return {{"stopping", HttpServer::Stopping() ? "the daemon is stopping" : ""},
          {"store", health.store_trouble},
          {"disk", LackOfRoom(context.data_dir, context.config.artefacts.disk_reserve)},
          {"host", health.host_trouble},
          {"slots", slots},
          {"cluster", health.executor_trouble.empty() ? health.losses : health.executor_trouble},
          {"simulator", MissingProgram()}};
}

const char* StatusText(const LiveHealth& health) {
  if (!health.store_trouble.empty()) return "store";
  if (!health.host_trouble.empty() || !health.executor_trouble.empty() || !health.disk_trouble.empty()) {
    return "paused";
  }
  return health.losses.empty() ? "ok" : "degraded";
}

}  // namespace myograde::server
