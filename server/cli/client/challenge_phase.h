// Finds a phase in the daemon's answer about challenges.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace myograde::server {

// The phase called `name` in an answer of GET /v1/challenges; null if there is none.
nlohmann::json PhaseIn(const nlohmann::json& answer, const std::string& name);

}  // namespace myograde::server
