// Whole stores as files, for the organiser: export, import and backup.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include <absl/status/status.h>

#include "server/api/context.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class TransferResource {
 public:
  // `context` must outlive it.
  explicit TransferResource(const ApiContext& context) : context_(context) {}

  void Install(Routes& routes);

 private:
  absl::Status SendExport(const Request& request, Response& response);
  absl::Status SendBackup(const Request& request, Response& response);
  ApiResult Import(const Request& request);

  // `make` writes the file; the client gets it with its length, or the reason why not.
  absl::Status SendMade(const char* type, Response& response,
                                   const std::function<absl::Status(const std::string&)>& make);
  std::string SpoolPath();

  const ApiContext& context_;
  std::atomic<int64_t> names_ = 0;  // of files in the spool
};

}  // namespace myograde::server
