// How a node reaches the folder of the attempt that it plays: through a disk that it shares with the
// daemon, or by HTTPS. Used by one thread at a time. Calls may take as long as the disk or the
// network does, in the case of a network at most minutes.
//
// Errors, of all functions: NotFoundError: it is not there. CancelledError: the attempt is over, or
// the daemon wants it to end; the message says which. UnavailableError, ResourceExhaustedError,
// DeadlineExceededError: trying again can help. UnauthenticatedError, OutOfRangeError,
// PermissionDeniedError: the daemon's certificate is not trusted, not valid now, or can't be checked, as
// the file of authorities can't be read. Any other: trying again can't help.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "server/executor/spool/forms.h"

namespace myograde::server {

class LeaseChannel {
 public:
  virtual ~LeaseChannel() = default;

  virtual absl::StatusOr<NodeOrder> Order() = 0;
  // AlreadyExistsError: another process plays it.
  virtual absl::Status PutClaim(const NodeClaim& claim) = 0;
  virtual absl::Status PutProof(const NodeProof& proof) = 0;
  // Writes the archive of the order's submission to the empty file `file`.
  virtual absl::Status FetchArtefact(const NodeArtefact& artefact, int file) = 0;
  // Records from `offset` on; again after an error, if need be with more behind them. Without any it
  // only asks whether to go on.
  virtual absl::Status AddRecords(int64_t offset, std::string_view bytes) = 0;
  // All of a file as a log. REQUIRES: IsLogName(log).
  virtual absl::Status PutLog(const std::string& log, int file) = 0;
  virtual absl::Status PutEnd(const NodeEnd& end) = 0;
};

// Whether an error of a channel may be over when it is tried again. Not called MayPass, as the
// store's (store/damage.h): a program with both would have one of them for both.
inline bool ChannelMayRecover(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsResourceExhausted(status) ||
         absl::IsDeadlineExceeded(status);
}

// The exit status of a node whose channel never answered but with this error.
inline int ExitStatusOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kUnauthenticated: return kNodeUntrusted;
    case absl::StatusCode::kOutOfRange: return kNodeClock;
    case absl::StatusCode::kPermissionDenied: return kNodeCaFile;
    case absl::StatusCode::kDeadlineExceeded:
    case absl::StatusCode::kUnavailable: return kNodeUnreachable;
    default: return kNodeTrouble;
  }
}

}  // namespace myograde::server
