#include "server/executor/slurm/lease_stream.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/clock.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"
#include "server/executor/slurm/node_state.h"
#include "server/executor/slurm/srun.h"
#include "server/runner/log_keeper.h"
#include "server/runner/runner_process.h"
#include "server/runtime/runtimes.h"

namespace myograde::server {
namespace {

constexpr int kSaid = 0;
constexpr int kNotSaid = 4;
constexpr int kLookMs = 500;
constexpr absl::Duration kOrderTime = absl::Minutes(2);
// Between two pieces of a submission.
constexpr absl::Duration kPieceTime = absl::Minutes(5);

std::string JobOfThis() {
  const char* job = std::getenv("SLURM_JOB_ID");
  return job == nullptr || std::string_view(job).find_first_not_of("0123456789") != std::string::npos
             ? "" : job;
}

absl::Status CheckRuntimeHere(const std::string& name, const std::string& digest,
                              const std::string& path) {
  const auto missing = [&](const std::string& why) {
    return absl::NotFoundError(absl::StrCat("the runtime ", name, " is not at ", path,
                                            " on this node", why, "; copy the daemon's there"));
  };
  std::error_code error;
  if (digest.empty()) {
    return std::filesystem::is_directory(path, error) ? absl::OkStatus() : missing("");
  }
  const absl::StatusOr<Runtime> runtime = ReadRuntime(path);
  if (!runtime.ok()) return missing(absl::StrCat(": ", runtime.status().message()));
  if (runtime->digest == digest) return absl::OkStatus();
  return missing(absl::StrCat(" with digest ", digest, " but ", runtime->digest));
}

class NodeLease {
 public:
  explicit NodeLease(const NodeOptions& options)
      : options_(options), stream_(STDIN_FILENO, STDOUT_FILENO) {
    me_.node = NodeName();
    me_.job = JobOfThis();
  }

  absl::Status Run() {
    RETURN_IF_ERROR(Tell());
    ASSIGN_OR_RETURN(const std::string text, stream_.Await("order", kOrderTime));
    ASSIGN_OR_RETURN(order_, ClusterOrderFromText(text));
    if (absl::Status ready = Prepare(); !ready.ok()) {
      me_.lost = PrintableUtf8(absl::StrCat("the node ", me_.node, " gave it back: ", ready.message()));
      me_.blamed = me_.unfit.empty();
      RETURN_IF_ERROR(Tell());
      return SendEnd(0, "");
    }
    ASSIGN_OR_RETURN(const std::unique_ptr<RunnerProcess> runner,
                     RunnerProcess::Start(order_.order));
    const absl::Status attended = Attend(*runner);
    if (fault_.empty()) RETURN_IF_ERROR(attended);
    me_.cpu_s = std::max(runner->site().cpu_s, policy_cpu_s_);
    me_.energy_j = EnergyOfJob();
    RETURN_IF_ERROR(Tell());
    return SendEnd(runner->wait_status(), absl::StrCat(runner->stderr_tail(), fault_));
  }

  void CleanUp() const {
    if (slot_.has_value()) slot_->CleanUp();
  }

 private:
  absl::Status Tell() { return stream_.Send("node", LeaseRecordToLine(me_)); }

  absl::Status SendEnd(int wait_status, const std::string& said) {
    return stream_.Send("end", nlohmann::json({{"wait_status", wait_status},
                                               {"said", said},
                                               {"record", last_record_}}).dump());
  }

  // Makes everything ready; an error says why the node can't play it.
  absl::Status Prepare() {
    ASSIGN_OR_RETURN(const std::string unfit, WhyUnfit(options_, order_));
    if (!unfit.empty()) {
      me_.unfit = absl::StrCat("it ", unfit);
      return absl::FailedPreconditionError(me_.unfit);
    }
    me_.processor = ProcessorName();
    RETURN_IF_ERROR(Tell());
    LeaseOrder& lease = order_.order;
    for (size_t i = 0; i < order_.runtimes.size(); ++i) {
      const auto& [name, digest] = order_.runtimes[i];
      RETURN_IF_ERROR(CheckRuntimeHere(name, digest, lease.runtimes[i]));
    }
    ASSIGN_OR_RETURN(NodeSlot slot, NodeSlot::Take(options_.node_dir, order_.uid_base));
    slot_.emplace(std::move(slot));
    lease.pinned = false;  // several leases may share a node
    RETURN_IF_ERROR(slot_->Prepare(lease));
    lease.cache_dir = options_.cache_dir;
    if (!lease.log_dir.empty()) lease.log_dir = slot_->work_dir() + "/logs";
    return PlaceArtefact();
  }

  absl::Status PlaceArtefact() {
    bool asked = false;
    bool more = false;
    const auto next = [&]() -> absl::StatusOr<std::string> {
      if (!std::exchange(asked, true)) RETURN_IF_ERROR(stream_.Send("want", ""));
      ASSIGN_OR_RETURN(std::string piece, stream_.Await("data", kPieceTime));
      more = !piece.empty();
      return piece;
    };
    absl::StatusOr<HeldArtefact> held = HoldArtefact(options_.node_dir, order_.artefact, next);
    // An archive tells its end itself; what follows it is on its way.
    while (held.ok() && more) RETURN_IF_ERROR(next().status());
    if (!held.ok()) {
      return absl::Status(held.status().code(), absl::StrCat("the submission did not reach it: ",
                                                             held.status().message()));
    }
    artefact_.emplace(*std::move(held));
    order_.order.artefact_dir = artefact_->folder;
    return absl::OkStatus();
  }

  // An error: nobody waits for the rest.
  absl::Status Attend(RunnerProcess& runner) {
    absl::Status status;
    std::optional<Deadline> grace;  // of one that was asked to end
    while (!runner.finished()) {
      pollfd entries[] = {{runner.stdout_fd(), POLLIN, 0},
                          {runner.stderr_fd(), POLLIN, 0},
                          {grace.has_value() ? -1 : options_.stop, POLLIN, 0},
                          {grace.has_value() ? -1 : STDIN_FILENO, POLLIN, 0}};
      poll(entries, std::size(entries), grace.has_value() ? 50 : kLookMs);
      status.Update(PassOn(runner, /*drop=*/!status.ok()));
      if (entries[2].revents != 0) {
        status.Update(absl::CancelledError("Slurm ended it: its job was preempted, cancelled or "
                                           "at its time limit"));
      }
      // The host says nothing any more.
      if (entries[3].revents != 0) status.Update(absl::CancelledError("its srun is gone"));
      if (status.ok()) continue;
      if (!grace.has_value()) {
        runner.AskToEnd();
        grace.emplace(Runner::kCleanUpGrace);
      } else if (grace->over()) {
        runner.KillNow();
      }
    }
    return status;
  }

  absl::Status PassOn(RunnerProcess& runner, bool drop) {
    const absl::StatusOr<std::vector<LeaseRecord>> records = runner.Read();
    if (drop) return absl::OkStatus();
    if (absl::IsDataLoss(records.status())) {
      // A fault of the grader's, as on the daemon's host: nothing that it printed is its last
      // record.
      fault_ = absl::StrCat("\n", records.status().message(), "\n");
      last_record_.clear();
    }
    RETURN_IF_ERROR(records.status());
    for (const LeaseRecord& record : *records) {
      if (const auto* end = std::get_if<LeaseEndRecord>(&record)) {
        policy_cpu_s_ = end->policy_cpu_s;
        last_record_ = LeaseRecordToLine(record);
        continue;
      }
      const auto* facts = std::get_if<EpisodeFacts>(&record);
      if (facts != nullptr && !facts->log.sha256.empty()) RETURN_IF_ERROR(SendLog(facts->log.sha256));
      RETURN_IF_ERROR(stream_.Send("record", LeaseRecordToLine(record)));
    }
    return absl::OkStatus();
  }

  absl::Status SendLog(const std::string& sha256) {
    const std::string path = absl::StrCat(order_.order.log_dir, "/", LogFileName(sha256));
    ASSIGN_OR_RETURN(const std::string log, ReadFile(path));
    unlink(path.c_str());
    return stream_.Send("log", absl::StrCat(sha256, "\n", log));
  }

  const NodeOptions& options_;
  LeaseStream stream_;
  NodeRecord me_;
  ClusterOrder order_;
  std::optional<NodeSlot> slot_;
  std::optional<HeldArtefact> artefact_;
  double policy_cpu_s_ = 0;
  std::string last_record_;  // of the runner; "": it has not printed it
  std::string fault_;        // of the runner, which printed a malformed record; "": none
};

}  // namespace

int PlayOnNode(const NodeOptions& options) {
  NodeLease lease(options);
  const absl::Status status = lease.Run();
  lease.CleanUp();
  if (status.ok()) return kSaid;
  std::fprintf(stderr, "myograde-node: %s\n", Sanitized(std::string(status.message())).c_str());
  return kNotSaid;
}

}  // namespace myograde::server
