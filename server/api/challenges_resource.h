// Challenges and their phases: their state, the organisers' acts on them, and the choices of teams.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class ChallengesResource {
 public:
  // `context` must outlive it.
  explicit ChallengesResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Choose(const Request& request, const nlohmann::json& body) const;
  // The act of an organiser on a phase, or on all submissions (`phase` "").
  ApiResult Act(const std::string& phase, const std::string& event,
                const nlohmann::json& body) const;

  // Whether it has submissions, and no file any more.
  bool IsFormer(const std::string& phase) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
