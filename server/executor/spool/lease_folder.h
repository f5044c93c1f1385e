// The spool: a folder through which the daemon and the nodes of a cluster hand each other leases.
//
//   epoch                    text of the daemon's present start
//   daemon                   empty; locked by the daemon as long as it uses the folder
//   artefacts/DIGEST.tar     packed submissions (artefact_tar.h)
//   leases/NAME/             an attempt of a lease; NAME is LEASE-ATTEMPT-NONCE
//     order.json   daemon    NodeOrder
//     claim        node      NodeClaim; the first one plays, and any other ends
//     node.json    node      NodeProof, before the first record
//     records      node      the runner's records, a line each; grows
//     logs/NAME    node      packed logs of episodes, each before the record that names it
//     end.json     node      NodeEnd, last
//     stop         daemon    empty; the node ends the lease
//
// All of it is private to the daemon's user (0700, 0600): orders hold hidden seeds. Errors are those
// of folder.h; all texts have the limits of forms.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/fd.h"
#include "server/executor/spool/folder.h"
#include "server/executor/spool/forms.h"

namespace myograde::server {

class LeaseFolder {
 public:
  const std::string& name() const { return name_; }
  const std::string& path() const { return folder_.path(); }

  // Daemon.
  absl::Status PutOrder(const NodeOrder& order) const;
  absl::Status Stop() const;
  // NotFoundError until the node has put it.
  absl::StatusOr<NodeClaim> Claim() const;
  absl::StatusOr<NodeProof> Proof() const;
  absl::StatusOr<NodeEnd> End() const;
  // Up to `most` bytes of the records from `offset` on; "" at their end, and before there are any.
  // InvalidArgumentError: there are more than kMostRecordBytes.
  absl::StatusOr<std::string> Records(int64_t offset, size_t most) const;
  // To read a log that a record names. REQUIRES: IsLogName(log).
  absl::StatusOr<Fd> OpenLog(const std::string& log) const;
  absl::StatusOr<int64_t> RecordsSize() const;  // 0 before there are any

  // Node, or the daemon in the place of a node that sends by HTTPS.
  absl::StatusOr<NodeOrder> Order() const;
  absl::StatusOr<std::string> OrderText() const;
  // AlreadyExistsError: another process plays it. Fine if this very claim is there.
  absl::Status PutClaim(const NodeClaim& claim) const;
  absl::Status PutProof(const NodeProof& proof) const;
  absl::Status PutEnd(const NodeEnd& end) const;
  // REQUIRES: the records are at least `offset` bytes long. ResourceExhaustedError, also where they
  // would become longer than kMostRecordBytes.
  absl::Status WriteRecords(int64_t offset, std::string_view bytes) const;
  // All of `source`, at most `most` bytes, as a log. REQUIRES: IsLogName(log).
  absl::Status PutLog(const std::string& log, const ByteSource& source, int64_t most) const;
  absl::StatusOr<bool> stopped() const;
  // False: the folder was removed, or another is in its place.
  absl::StatusOr<bool> IsThere() const;

 private:
  friend class Spool;
  LeaseFolder(std::string name, Folder leases, Folder folder)
      : name_(std::move(name)), leases_(std::move(leases)), folder_(std::move(folder)) {}

  std::string name_;
  Folder leases_;
  Folder folder_;
};

class Spool {
 public:
  // The daemon's: makes what is missing. FailedPreconditionError, of both: other users may write to
  // one of its folders.
  static absl::StatusOr<Spool> Make(const std::string& path);
  // A node's: all must be there.
  static absl::StatusOr<Spool> Open(const std::string& path);

  // For one daemon at a time, until the descriptor is closed; errors as of Folder::Lock.
  absl::StatusOr<Fd> Hold() const { return folder_.Lock("daemon"); }
  absl::Status PutEpoch(const std::string& epoch) const;
  absl::StatusOr<std::string> Epoch() const;

  // REQUIRES, of all: IsLeaseName(name).
  absl::StatusOr<LeaseFolder> MakeLease(const std::string& name) const;  // AlreadyExistsError
  absl::StatusOr<LeaseFolder> OpenLease(const std::string& name) const;
  absl::Status RemoveLease(const std::string& name) const;
  // The names of all lease folders, and of whatever else is there.
  absl::StatusOr<std::vector<std::string>> Leases() const;

  // Removes all leases, and with them all that a node that still plays one can do. Goes on after an
  // error, and returns the first.
  absl::Status RemoveLeases() const;

  // Packed submissions. REQUIRES: IsDigest(digest).
  absl::StatusOr<bool> HasArtefact(const std::string& digest) const;
  absl::StatusOr<Fd> OpenArtefact(const std::string& digest) const;
  std::string ArtefactPath(const std::string& digest) const;
  // All of `source`, at most `most` bytes.
  absl::Status PutArtefact(const std::string& digest, const ByteSource& source,
                           int64_t most) const;
  absl::Status RemoveArtefact(const std::string& digest) const;
  absl::StatusOr<std::vector<std::string>> Artefacts() const;  // digests

  // Whether something can be written and read again.
  absl::Status Probe() const;

  const std::string& path() const { return folder_.path(); }

 private:
  static absl::StatusOr<Spool> OfFolders(Folder folder, Folder artefacts, Folder leases);
  Spool(Folder folder, Folder artefacts, Folder leases)
      : folder_(std::move(folder)), artefacts_(std::move(artefacts)), leases_(std::move(leases)) {}

  Folder folder_;
  Folder artefacts_;
  Folder leases_;
};

}  // namespace myograde::server
