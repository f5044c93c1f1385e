// The content of a runtime's folder, to compare it with what its runtime.json says.
#pragma once

#include <cstdint>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/runtime/runtimes.h"

namespace myograde::server {

struct RuntimeTree {
  std::string digest;  // SHA-256 (hex) of the canonical listing, as of submissions
  int64_t bytes = 0;   // of all files
  int64_t files = 0;   // files, folders and links
};

// Reads everything below `folder` but its runtime.json; links are not followed. A GB takes a few
// seconds. InternalError: something can't be read.
absl::StatusOr<RuntimeTree> ReadRuntimeTree(const std::string& folder);

// Whether a runtime still has the content that it was made with; one without a digest has.
// DataLossError: it has another; InternalError: it can't be read.
absl::Status CheckRuntime(const Runtime& runtime);

}  // namespace myograde::server
