// What proves a result: the logs of episodes, receipts and the key that they are signed with.
#pragma once

#include <optional>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class ProofResource {
 public:
  // `context` must outlive it.
  explicit ProofResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult GetReceipt(const Request& request) const;
  ApiResult GetKey(const Request& request) const;
  absl::Status SendLog(const Request& request, Response& response) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
