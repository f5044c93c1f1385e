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
  ApiResult List(const httplib::Request& request) const;
  ApiResult GetHead(const httplib::Request& request) const;
  ApiResult Prove(const httplib::Request& request) const;
  ApiResult Compare(const httplib::Request& request) const;

  const ApiContext& context_;
};

}  // namespace myograde::server
