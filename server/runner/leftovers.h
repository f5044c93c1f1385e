// Processes that a lease has killed but that are not dead yet: one stuck in the kernel, or so many
// that a busy host takes long to reap them. After SIGKILL they run none of their own code, but they
// hold their user, memory and disk until they are gone. So no other policy starts beside them, and
// the lease's slot stays taken. What the lease has recorded stands.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <absl/time/time.h>

#include "server/runner/policy_run.h"

namespace myograde::server {

class Leftovers {
 public:
  // Ends a run, and keeps it if any of its processes survive. Takes up to kill_s.
  void End(std::unique_ptr<PolicyRun> run);
  // Keeps the simulator's, which was killed without success. `sim` and `group` must outlive this
  // object.
  void Keep(Sandbox& sim, ControlGroup& group);

  // True once nothing is left. Never blocks.
  bool Gone();

 private:
  std::vector<std::unique_ptr<PolicyRun>> runs_;
  Sandbox* sim_ = nullptr;
  ControlGroup* sim_group_ = nullptr;
};

}  // namespace myograde::server
