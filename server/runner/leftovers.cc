#include "server/runner/leftovers.h"

#include <utility>

namespace myograde::server {

void Leftovers::End(std::unique_ptr<PolicyRun> run) {
  if (!run->End()) runs_.push_back(std::move(run));
}

void Leftovers::Keep(Sandbox& sim, ControlGroup& group) {
  sim_ = &sim;
  sim_group_ = &group;
}

bool Leftovers::Gone() {
  std::erase_if(runs_, [](const std::unique_ptr<PolicyRun>& run) { return run->Gone(); });
  if (sim_ != nullptr && sim_->Gone() && sim_group_->Members().empty()) sim_ = nullptr;
  return runs_.empty() && sim_ == nullptr;
}

}  // namespace myograde::server
