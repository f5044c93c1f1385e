// Writes the order of a lease for a node of a cluster, as a daemon does, and of the same lease for a
// local runner:
//
//   node_order FOLDER TRACK EPISODES CACHE UID_BASE WORK
//
// FOLDER: a submission. WORK: an empty folder; its file cluster.json is then the text of a ClusterOrder,
// policy/ the submission's files, and order.json an order for myograde-runner, which plays in WORK/lease
// and keeps logs in WORK/logs.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "server/artefact/artefact.h"
#include "server/base/paths.h"
#include "server/executor/slurm/lease_stream.h"
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

int Main(char** words) {
  const std::string work = words[6];
  Must(PackArtefact(words[1], work + "/upload", {}).status());
  ClusterOrder order;
  const Artefact artefact = Must(UnpackArtefact(work + "/upload", work + "/policy", {}));
  order.artefact = artefact.digest;
  order.uid_base = std::atol(words[5]);
  LeaseOrder& lease = order.order;
  lease.lease = "7";
  lease.command = artefact.manifest.command;
  lease.track = Must(LoadTrackConfig(ConfigDir() + "/tracks", words[2], ""));
  for (int64_t i = 0; i < std::atol(words[3]); ++i) {
    lease.episodes.push_back({i, 7000 + static_cast<uint64_t>(i), 1 + static_cast<uint64_t>(i)});
  }
  lease.artefact_dir = work + "/policy";
  lease.work_dir = work + "/lease";
  lease.log_dir = work + "/logs";
  lease.cache_dir = words[4];
  lease.uid = order.uid_base < 0 ? -1 : order.uid_base + 100;
  order.grader = CanonicalJson(GraderBuild(words[4]));
  fs::create_directory(lease.work_dir);
  fs::create_directory(lease.log_dir);
  Must(WriteFile(work + "/cluster.json", ClusterOrderToText(order)));
  Must(WriteFile(work + "/order.json", LeaseOrderToJson(lease).dump()));
  return 0;
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) { return argc == 7 ? myograde::server::Main(argv) : 2; }
