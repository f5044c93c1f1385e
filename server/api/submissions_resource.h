// Submissions: making, listing, following and cancelling them, and the organiser's marks.
#pragma once

#include <cstdint>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class SubmissionsResource {
 public:
  // `context` must outlive it.
  explicit SubmissionsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult Get(const Request& request) const;
  ApiResult Submit(const Request& request, const nlohmann::json& body) const;
  ApiResult Cancel(const Request& request, const nlohmann::json& body) const;
  ApiResult Mark(const Request& request, const nlohmann::json& body) const;
  ApiResult StatusAnswer(int64_t submission) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
