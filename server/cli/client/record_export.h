// Writes the public record and all that it is checked with to a folder
// (server/cli/offline/record_folder.h says what is in it).
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <functional>
#include <string>

#include "server/cli/client/client.h"

namespace myograde::server {

// Writes everything, and returns {"folder", "size", "root", "receipts", "withheld", "boards"}.
// `progress` is called with the receipts written so far and in total. While results keep ending, it
// begins again a few times; UnavailableError if they still do. InvalidArgumentError: the folder has files already,
// or can't be written.
absl::StatusOr<Json> ExportRecord(const Client& client, const std::string& folder,
                                  const std::function<void(int64_t done, int64_t total)>& progress);

}  // namespace myograde::server
