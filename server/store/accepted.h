// What a request for a submission or a re-run was accepted as, and the keys (the header
// Idempotency-Key) by which a client may send it again when the answer was lost.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

namespace SQLite {
class Database;
}

namespace myograde::server {

struct Accepted {
  int64_t submission = 0;
  int64_t evaluation = 0;
  std::vector<int64_t> leases = {};  // in block order
  // True: nothing new was accepted. The team already has this artefact's ranked evaluation;
  // `submission` and `evaluation` are those, and `leases` is empty.
  bool linked = false;
  // True: nothing new was accepted, as the same request came before with the same key. All but
  // `leases`, which is empty, is what it was accepted as then.
  bool repeated = false;

  bool is_new() const { return !linked && !repeated; }
};

struct RequestKey {
  std::string key = "";      // chosen by the client; "": the request has none
  std::string request = "";  // SHA-256 of everything that it asks for
};

// The API's error code (ErrorCodeOf in quota.h) for a key that came with another request before.
inline constexpr char kKeyReusedCode[] = "idempotency_mismatch";

// A key is kept for this long, and of one caller the newest of these.
inline constexpr absl::Duration kKeyAge = absl::Hours(24);
inline constexpr int64_t kKeysOfOne = 1000;

// What `who` was answered when this key came for the first time; nullopt if it is new, or if there
// is none. FailedPreconditionError with kKeyReusedCode if it came with another request; a damaged
// row (damage.h). Internal to the store: throws SQLite::Exception.
absl::StatusOr<std::optional<Accepted>> FindRequestKey(SQLite::Database& db,
                                                       const std::string& who,
                                                       const RequestKey& key);

}  // namespace myograde::server
