#include "server/cli/client/challenge_phase.h"

namespace myograde::server {

nlohmann::json PhaseIn(const nlohmann::json& answer, const std::string& name) {
  for (const auto& challenge : answer.value("challenges", nlohmann::json::array())) {
    for (const auto& phase : challenge.value("phases", nlohmann::json::array())) {
      if (phase.value("phase", "") == name) return phase;
    }
  }
  return nullptr;
}

}  // namespace myograde::server
