#include "server/cli/client/print_answer.h"

#include "server/cli/base/exit_status.h"
#include "server/cli/base/print_json.h"

namespace myograde::server {

int PrintAnswer(const absl::StatusOr<nlohmann::json>& answer, bool json,
                const std::function<void(const nlohmann::json&)>& print) {
  if (!answer.ok()) return ReportError(answer.status());
  if (json) {
    PrintJson(*answer);
  } else {
    print(*answer);
  }
  return kDone;
}

}  // namespace myograde::server
