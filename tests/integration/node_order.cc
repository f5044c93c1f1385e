// Hands a lease to a node, as a daemon of a cluster does, and the same lease to a local runner:
//
//   node_order SPOOL NAME EPOCH FOLDER TRACK EPISODES CACHE UID_BASE WORK
//
// SPOOL is made if it is missing. FOLDER: a submission. WORK: an empty folder; its file order.json is
// then an order for myograde-runner, which plays in WORK/lease and keeps logs in WORK/logs.
#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/artefact/artefact.h"
#include "server/base/paths.h"
#include "server/executor/spool/artefact_tar.h"
#include "server/executor/spool/lease_folder.h"
#include "server/proof/grader_build.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

template <typename T>
T Must(absl::StatusOr<T> value) {
  if (value.ok()) return *std::move(value);
  std::fprintf(stderr, "node_order: %s\n", std::string(value.status().message()).c_str());
  std::exit(1);
}

void Must(const absl::Status& status) {
  Must(status.ok() ? absl::StatusOr<int>(0) : absl::StatusOr<int>(status));
}

// Packs the submission into the spool, through the daemon's own folder for it.
NodeArtefact Place(const Spool& spool, const std::string& submission, const std::string& work) {
  Must(PackArtefact(submission, work + "/upload", {}).status());
  const Artefact artefact = Must(UnpackArtefact(work + "/upload", work + "/policy", {}));
  const std::string path = work + "/tar";
  const Fd file(open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  const PackedFolder packed =
      Must(PackArtefactFolder(work + "/policy", artefact.digest, file.get()));
  lseek(file.get(), 0, SEEK_SET);
  Must(spool.PutArtefact(artefact.digest, BytesOf(file.get()), packed.bytes));
  return {artefact.digest, packed.sha256, packed.bytes};
}

int Main(char** words) {
  const std::string work = words[9];
  const Spool spool = Must(Spool::Make(words[1]));
  NodeOrder order;
  order.name = words[2];
  order.epoch = words[3];
  order.artefact = Place(spool, words[4], work);
  order.uid_base = std::atol(words[8]);
  order.wall_s = 300;
  LeaseOrder& lease = order.order;
  lease.lease = order.name;
  lease.command = Must(ReadManifest(work + "/policy")).command;
  lease.track = Must(LoadTrackConfig(ConfigDir() + "/tracks", words[5], ""));
  for (int64_t i = 0; i < std::atol(words[6]); ++i) {
    lease.episodes.push_back({i, 7000 + static_cast<uint64_t>(i), 1 + static_cast<uint64_t>(i)});
  }
  order.grader = CanonicalJson(GraderBuild(words[7]));
  Must(spool.PutEpoch(order.epoch));
  Must(Must(spool.MakeLease(order.name)).PutOrder(order));

  lease.artefact_dir = work + "/policy";
  lease.work_dir = work + "/lease";
  lease.log_dir = work + "/logs";
  lease.cache_dir = words[7];
  lease.uid = order.uid_base < 0 ? -1 : order.uid_base + 100;
  fs::create_directory(lease.work_dir);
  fs::create_directory(lease.log_dir);
  Must(WriteFile(work + "/order.json", LeaseOrderToJson(lease).dump()));
  return 0;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return argc == 10 ? myograde::server::Main(argv) : 2; }
