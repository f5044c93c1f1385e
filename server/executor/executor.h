// Where leases run: this host, or the nodes of a cluster (slurm/). The engine decides which
// lease runs next and what its end means; an executor places it, and says how it goes.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/lease/lease.h"
#include "server/runner/runner_process.h"
#include "server/sandbox/slot_processes.h"

namespace myograde::server {

// What an executor needs to know of a lease beside its order.
struct LeaseSubject {
  std::string artefact;    // digest of the files in order.artefact_dir; "": not a submission's
  std::vector<std::pair<std::string, std::string>> runtimes;  // those of the order: name and digest
  absl::Duration wall;     // longest run
};

struct DrainedNode {
  std::string node;
  std::string why;  // one sentence
};

// What people see of a cluster's node.
struct NodeView {
  std::string name = {};
  std::string state = "new";   // it has not proved itself yet; or "proved", or "drained"
  std::string why = {};        // of a drained one
  std::string processor = {};  // as it describes itself; "": not known
  int running = 0;        // leases
  int64_t done = 0;       // leases that ended well, since the daemon started
  int64_t faults = 0;     // those that ended by the grader's fault
};

class Executor {
 public:
  virtual ~Executor() = default;

  // Has a runner started on the order, in its slot, and creates the order's work folder. Never
  // waits for another host. An error is the grader's fault, and leaves nothing behind.
  virtual absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                        const LeaseSubject& subject) = 0;

  // Removes a dead runner's work folder. What can't be removed is logged, and left to the daemon's
  // next start.
  virtual void CleanUp(const std::string& work_dir);

  // Living processes on this host in the sandboxes of slots `first` to `first + count - 1`, whoever
  // started them: by slot, described for people.
  virtual std::map<int, std::string> FindProcesses(int /*first*/, int /*count*/) { return {}; }

  // True if leases run on other hosts. Then they wait there for a processor before they begin
  // (Runner::begun), slots are jobs, and this host's self-test says nothing.
  virtual bool remote() const { return false; }

  // Why no lease can start now, in one sentence; "" if leases can.
  virtual std::string CannotStart() const { return ""; }

  // The attempt on this node ended: with a fault of the grader's, or well.
  virtual void NoteEnd(const std::string& /*node*/, bool /*fault*/) {}

  // The nodes that it knows, by name. Safe from any thread, as are the three below.
  virtual std::vector<NodeView> Nodes() const { return {}; }
  // Nodes that get no leases, and why: from the store at the start, by an organiser, or by itself.
  // FailedPreconditionError where leases run on this host.
  virtual absl::Status Drain(const std::string& node, const std::string& why);
  // The node proves itself again before its next lease.
  virtual absl::Status Admit(const std::string& node);
  // What it drained by itself since the last call; the engine has the store remember it.
  virtual std::vector<DrainedNode> TakeDrained() { return {}; }

 protected:
  // A new, empty folder for a lease, private to this user.
  static absl::Status MakeWorkDir(const std::string& path);
};

// Leases run on this host, each a process of its own.
class LocalExecutor : public Executor {
 public:
  explicit LocalExecutor(SlotProcesses slots) : slots_(std::move(slots)) {}
  absl::StatusOr<std::unique_ptr<Runner>> Start(const LeaseOrder& order,
                                                const LeaseSubject& subject) override;
  std::map<int, std::string> FindProcesses(int first, int count) override {
    return slots_.Find(first, count);
  }

 private:
  const SlotProcesses slots_;
};

}  // namespace myograde::server
