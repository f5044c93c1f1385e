// Evaluations: their results, and re-runs.
#pragma once

#include <cstdint>

#include <nlohmann/json.hpp>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class EvaluationsResource {
 public:
  // `context` must outlive it.
  explicit EvaluationsResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  // The original evaluation of a submission.
  ApiResult GetResult(const Request& request) const;
  ApiResult Get(const Request& request) const;
  ApiResult Rerun(const Request& request, const nlohmann::json& body) const;
  ApiResult RerunAnswer(const Accepted& accepted) const;
  ApiResult EvaluationAnswer(int64_t id, bool of_submission, const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
