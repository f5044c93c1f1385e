// Tells a data folder from a copy of it: the store records which folder it is at home in.
#pragma once

#include <optional>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

namespace myograde::server {

struct DataHome {
  // 64 hexadecimal digits, other ones for each copy, on any host. A folder that is renamed on its disk
  // keeps them.
  std::string key;
  std::string place;  // "PATH on host NAME", for people
};

// Of the folder `dir`. UnavailableError if it can't be examined.
absl::StatusOr<DataHome> HomeOf(const std::string& dir);

// What the store at the path `store` has recorded; nullopt: nothing yet. REQUIRES, also of the next:
// the store was opened (store.h) by this program. Errors as in connection.h.
absl::StatusOr<std::optional<DataHome>> RecordedHome(const std::string& store);
absl::Status RecordHome(const std::string& store, const DataHome& home);

}  // namespace myograde::server
