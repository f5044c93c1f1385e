// An export as CSV.
#pragma once

#include <string>

#include <absl/status/status.h>

namespace myograde::server {

// Writes the JSON export in the file `from` to `folder`, which is made if missing: a file for each
// table, and SHA256SUMS. `mark`: each file begins with the byte order mark of UTF-8. InvalidArgumentError
// if a file can't be written.
absl::Status WriteCsv(const std::string& from, const std::string& folder, bool mark);

}  // namespace myograde::server
