// The door of nodes that send by HTTPS: writes what they send into the spool, as nodes with the
// shared folder do themselves.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "server/executor/lease_door.h"
#include "server/executor/spool/lease_folder.h"

namespace myograde::server {

class SpoolDoor : public LeaseDoor {
 public:
  // `spool` must outlive it. `most_log_bytes`: of a packed log (log_bytes of sandbox/sim.json).
  SpoolDoor(const Spool& spool, int64_t most_log_bytes)
      : spool_(spool), most_log_bytes_(most_log_bytes) {}

  // A token for an attempt whose folder and order are there: 64 hexadecimal digits. Only its hash is
  // kept. `artefact`: the digest of its packed submission; "": it has none.
  absl::StatusOr<std::string> Open(const std::string& name, const std::string& artefact);
  // The token is good no more. Requests that run may still end.
  void Close(const std::string& name);

  absl::Status Check(const std::string& name, std::string_view token) const override;
  absl::StatusOr<std::string> OrderText(const std::string& name) const override;
  absl::StatusOr<std::string> ArtefactPath(const std::string& name) const override;
  absl::Status PutClaim(const std::string& name, const NodeClaim& claim) override;
  absl::Status PutProof(const std::string& name, const NodeProof& proof) override;
  absl::Status PutEnd(const std::string& name, const NodeEnd& end) override;
  absl::StatusOr<RecordsState> AddRecords(const std::string& name, int64_t offset,
                                          std::string_view bytes) override;
  absl::Status PutLog(const std::string& name, const std::string& log,
                      const ByteSource& source) override;
  int64_t most_log_bytes() const override { return most_log_bytes_; }

 private:
  // One attempt. Its records have one writer at a time.
  struct Attempt {
    Attempt(std::string hash, std::string digest, LeaseFolder opened)
        : token_hash(std::move(hash)), artefact(std::move(digest)), folder(std::move(opened)) {}
    const std::string token_hash;
    const std::string artefact;
    const LeaseFolder folder;
    Mutex records;
  };
  // NotFoundError.
  absl::StatusOr<std::shared_ptr<Attempt>> Find(const std::string& name) const;

  const Spool& spool_;
  const int64_t most_log_bytes_;
  mutable Mutex mutex_;
  std::map<std::string, std::shared_ptr<Attempt>> attempts_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
