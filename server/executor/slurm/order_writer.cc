#include "server/executor/slurm/order_writer.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>
#include <utility>

#include <spdlog/spdlog.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/executor/spool/artefact_tar.h"

namespace myograde::server {

OrderWriter::OrderWriter(std::string work_dir, Grader grader)
    : work_dir_(std::move(work_dir)), grader_(std::move(grader)) {}

absl::StatusOr<NodeArtefact> OrderWriter::Pack(const Spool& spool, const std::string& artefact,
                                               const std::string& artefact_dir) const {
  std::string name = work_dir_ + "/.archive-XXXXXX";
  const Fd archive(::mkostemp(name.data(), O_CLOEXEC));
  if (!archive.valid()) return DiskError(work_dir_, "used for an archive");
  ::unlink(name.c_str());  // nothing stays, whatever happens
  ASSIGN_OR_RETURN(const PackedFolder packed,
                   PackArtefactFolder(artefact_dir, artefact, archive.get()));
  if (::lseek(archive.get(), 0, SEEK_SET) != 0) return DiskError(work_dir_, "read");
  RETURN_IF_ERROR(spool.PutArtefact(artefact, BytesOf(archive.get()), packed.bytes));
  return NodeArtefact{artefact, packed.sha256, packed.bytes};
}

absl::Status OrderWriter::Write(const Spool& spool, NodeOrder& order, const std::string& artefact,
                                const std::string& artefact_dir, absl::Duration now) {
  if (!artefact.empty()) {
    auto known = packed_.find(artefact);
    if (known == packed_.end()) {
      ASSIGN_OR_RETURN(NodeArtefact packed, Pack(spool, artefact, artefact_dir));
      known = packed_.insert_or_assign(artefact, Packed{std::move(packed), now}).first;
    }
    known->second.used = now;
    order.artefact = known->second.artefact;
  }
  order.grader = CanonicalJson(grader_({order.order.adapter}));
  ASSIGN_OR_RETURN(const LeaseFolder folder, spool.MakeLease(order.name));
  absl::Status put = folder.PutOrder(order);
  if (!put.ok()) spool.RemoveLease(order.name).IgnoreError();
  return put;
}

void OrderWriter::Prune(const Spool& spool, const std::set<std::string>& used,
                        absl::Duration now) {
  std::erase_if(packed_, [&](const auto& entry) {
    if (used.contains(entry.first) || now - entry.second.used < kKeepUnused) return false;
    const absl::Status removed = spool.RemoveArtefact(entry.first);
    if (!removed.ok()) spdlog::warn("{}", std::string(removed.message()));
    return removed.ok();
  });
}

}  // namespace myograde::server
