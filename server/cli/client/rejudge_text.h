// Rejudges as text, from the JSON of the API (GET /v1/rejudges).
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace myograde::server {

// "phase final", or the track and the profile of a board without a phase.
std::string RejudgedBoard(const nlohmann::json& rejudge);

// One line for each rejudge of a list.
void PrintRejudges(const nlohmann::json& answer);

// What it is, how far it is and what became of it; with "boards", every rank's change on each.
void PrintRejudge(const nlohmann::json& rejudge);

}  // namespace myograde::server
