// The channel through a shared disk.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <absl/time/time.h>

#include "protocol/base/clock.h"
#include "server/executor/node/channel.h"
#include "server/executor/spool/lease_folder.h"

namespace myograde::server {

class FolderChannel : public LeaseChannel {
 public:
  // How long the daemon's epoch may be missing, as it is while a disk is stale.
  static constexpr absl::Duration kEpochMissing = absl::Minutes(1);

  // The folder of attempt `name` in the spool at `path`; neither is touched yet. `clock` must outlive
  // it.
  FolderChannel(std::string path, std::string name, const Clock& clock = SystemClock())
      : path_(std::move(path)), name_(std::move(name)), clock_(clock) {}

  absl::StatusOr<NodeOrder> Order() override;
  absl::Status PutClaim(const NodeClaim& claim) override;
  absl::Status PutProof(const NodeProof& proof) override;
  absl::Status FetchArtefact(const NodeArtefact& artefact, int file) override;
  absl::Status AddRecords(int64_t offset, std::string_view bytes) override;
  absl::Status PutLog(const std::string& log, int file) override;
  absl::Status PutEnd(const NodeEnd& end) override;

 private:
  absl::Status Open();
  // Whether the attempt is still wanted.
  absl::Status Look();

  const std::string path_;
  const std::string name_;
  const Clock& clock_;
  std::optional<Spool> spool_;
  std::optional<LeaseFolder> folder_;
  std::string epoch_;  // of the order
  std::optional<absl::Duration> epoch_missing_;  // since when; monotonic
};

}  // namespace myograde::server
