// The public record: its entries, its signed head, and proofs of both.
#pragma once

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class RecordResource {
 public:
  // `context` must outlive it.
  explicit RecordResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  ApiResult List(const Request& request) const;
  ApiResult GetHead(const Request& request) const;
  ApiResult Prove(const Request& request) const;
  ApiResult Compare(const Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
