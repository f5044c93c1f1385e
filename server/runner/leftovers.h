// What a lease ended and can't be killed yet: a process deep in the kernel, or a crowd that a
// busy host takes long to bury. It has had its SIGKILL, so it runs no more of its own code; but
// its user, memory and disk are in use until it is gone. So no other policy starts beside it,
// and the lease's slot stays taken. It takes nothing from what the lease has recorded.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <absl/time/time.h>

#include "server/runner/policy_run.h"

namespace myograde::server {

class Leftovers {
 public:
  // Ends a run, and keeps it if something of it stays. Takes up to kill_s.
  void End(std::unique_ptr<PolicyRun> run);
  // The simulator's, whose sandbox and group outlive this object. It was killed in vain.
  void Keep(Sandbox& sim, ControlGroup& group);

  // True once nothing is left. Never blocks.
  bool Gone();

 private:
  std::vector<std::unique_ptr<PolicyRun>> runs_;
  Sandbox* sim_ = nullptr;
  ControlGroup* sim_group_ = nullptr;
};

}  // namespace myograde::server
