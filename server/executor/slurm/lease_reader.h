// Reads what a node writes for one attempt of a lease, as it comes, and checks it as a local
// runner's output is checked. For one thread; looks, and never waits but for the disk.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/sha256.h"
#include "protocol/lease/lease.h"
#include "server/executor/spool/lease_folder.h"

namespace myograde::server {

// What a look added.
struct LeaseNews {
  bool looked = false;  // false: the folder could not be read; try again
  std::optional<NodeClaim> claim;
  std::optional<NodeProof> proof;
  std::vector<LeaseRecord> records;
  std::optional<NodeEnd> end;  // after all of its records
  std::string broken;          // why what is there can't be what the runner said; nothing follows
};

class LeaseReader {
 public:
  // For what must be there already to be seen: shared folders can be slow to show it.
  static constexpr absl::Duration kPatience = absl::Seconds(15);

  // Logs go to the folder `logs`; "": they are not kept.
  LeaseReader(std::string name, std::string logs);

  // Times are monotonic. Takes at most about 4 MiB of records.
  LeaseNews Look(const Spool& spool, absl::Duration now);

  // The node's proof was accepted: its records count from now on.
  void Trust() { trusted_ = true; }

 private:
  void ReadClaim(const LeaseFolder& folder, LeaseNews& news);
  void ReadRecords(const LeaseFolder& folder, absl::Duration now, LeaseNews& news);
  // Takes bytes into `line_`; false: no more can be read now.
  bool ReadBytes(const LeaseFolder& folder, absl::Duration now, LeaseNews& news);
  void TakeLines(const LeaseFolder& folder, absl::Duration now, LeaseNews& news);
  void ReadEnd(const LeaseFolder& folder, absl::Duration now, LeaseNews& news);
  // Trouble that may pass: `broken` only once it has lasted.
  void Bear(const std::string& why, absl::Duration now, LeaseNews& news);

  const std::string name_;
  const std::string logs_;
  std::optional<NodeClaim> claim_;
  bool proved_ = false;
  bool trusted_ = false;
  bool broken_ = false;
  // The runner's last record, held back until the node has said that all before it is what it wrote.
  std::optional<LeaseEndRecord> last_;
  int64_t offset_ = 0;          // of the records that were read
  std::string lines_;           // those not taken yet
  Sha256 hash_;                 // of those that were read
  std::optional<NodeEnd> end_;  // read, and delivered once the records are complete
  bool delivered_ = false;
  std::optional<absl::Duration> trouble_since_;
};

}  // namespace myograde::server
