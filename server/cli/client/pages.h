// Lists that the API gives out page by page (server/api/README.md).
#pragma once

#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "server/cli/client/client.h"

namespace myograde::server {

// All pages of the list at `path`, which has no query, as one answer; `rows` is the key of its rows.
// Errors of Client::Get.
absl::StatusOr<nlohmann::json> GetAllPages(const Client& client, const std::string& path,
                                           const std::string& rows);

}  // namespace myograde::server
