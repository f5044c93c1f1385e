// Copies of a whole store as one file. Internal to the store.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/status/status.h>

namespace myograde::server {

// Copies the database that `source` (of the file `name`) has open to the file `path`, in one read
// transaction, and checks the copy. `progress` gets page counts from time to time; damaged rows are
// copied as they are and passed to `damaged`. DataLossError: the database itself is damaged. Throws
// SQLite's exceptions, which are about `path`. On failure an incomplete file stays.
absl::Status CopyDatabase(SQLite::Database& source, const std::string& name,
                          const std::string& path,
                          const std::function<void(int64_t done, int64_t total)>& progress,
                          const std::function<void(const std::string& what)>& damaged);

}  // namespace myograde::server
