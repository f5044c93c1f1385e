// Puts the orders of attempts into the spool, and the submissions that they play. For one thread:
// packs files, and waits for the disk.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/time/time.h>
#include <nlohmann/json.hpp>

#include "server/executor/spool/lease_folder.h"

namespace myograde::server {

class OrderWriter {
 public:
  // A packed submission that no order has named for so long is removed.
  static constexpr absl::Duration kKeepUnused = absl::Minutes(10);

  // This host's GraderBuild with these adapters.
  using Grader = std::function<nlohmann::json(const std::vector<std::string>&)>;
  // `work_dir`: of the daemon's own disk, for archives that are being made.
  OrderWriter(std::string work_dir, Grader grader);

  // Makes the attempt's folder with its order, which lacks only the archive and the grader's build:
  // both are filled in. `artefact_dir`: the files of `artefact`; "": the order plays none. Leaves
  // nothing behind after an error, which is one of folder.h or artefact_tar.h.
  absl::Status Write(const Spool& spool, NodeOrder& order, const std::string& artefact,
                     const std::string& artefact_dir, absl::Duration now);

  // Removes packed submissions that are none of `used` and were not named for a while.
  void Prune(const Spool& spool, const std::set<std::string>& used, absl::Duration now);
  // Begins anew with a spool: nothing is packed in it.
  void Forget() { packed_.clear(); }

 private:
  struct Packed {
    NodeArtefact artefact;
    absl::Duration used;
  };
  absl::StatusOr<NodeArtefact> Pack(const Spool& spool, const std::string& artefact,
                                    const std::string& artefact_dir) const;

  const std::string work_dir_;
  const Grader grader_;
  std::map<std::string, Packed> packed_;  // by digest
};

}  // namespace myograde::server
