// How the nodes of a cluster that share no folder with the daemon reach their leases: what the API
// needs of an executor. Each attempt of a lease has a token of its own, which is good for nothing
// else and ends with it. Safe from any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/executor/spool/folder.h"
#include "server/executor/spool/forms.h"

namespace myograde::server {

// What a node hears whenever it sends records.
struct RecordsState {
  int64_t size = 0;    // of all records that are here
  bool taken = false;  // those that it sent are among them
  bool stop = false;   // it must end the lease
};

class LeaseDoor {
 public:
  virtual ~LeaseDoor() = default;

  // Whether a token is that of an attempt. NotFoundError: the attempt is over, or never was;
  // PermissionDeniedError: the token is another one's.
  virtual absl::Status Check(const std::string& name, std::string_view token) const = 0;

  // REQUIRES, of all below: the token was checked. NotFoundError if the attempt has ended since;
  // other errors are those of folder.h.
  virtual absl::StatusOr<std::string> OrderText(const std::string& name) const = 0;
  // The file of the packed submission. NotFoundError also if the order has none.
  virtual absl::StatusOr<std::string> ArtefactPath(const std::string& name) const = 0;
  // AlreadyExistsError: another process has claimed it.
  virtual absl::Status PutClaim(const std::string& name, const NodeClaim& claim) = 0;
  virtual absl::Status PutProof(const std::string& name, const NodeProof& proof) = 0;
  virtual absl::Status PutEnd(const std::string& name, const NodeEnd& end) = 0;
  // Bytes that follow the first `offset` ones; may repeat some, or be none at all. Not taken: they
  // leave a gap, or differ from what is here.
  virtual absl::StatusOr<RecordsState> AddRecords(const std::string& name, int64_t offset,
                                                  std::string_view bytes) = 0;
  // InvalidArgumentError: larger than most_log_bytes(). REQUIRES: IsLogName(log).
  virtual absl::Status PutLog(const std::string& name, const std::string& log,
                              const ByteSource& source) = 0;
  virtual int64_t most_log_bytes() const = 0;
};

}  // namespace myograde::server
