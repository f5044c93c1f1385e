// A policy that gives an episode up once the first entry of an observation is above 0.5, and else
// answers with the number of steps. With a file as argument it prints there what it does.
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "policies/cpp/kit.h"

namespace {

class Impatient : public myograde::Policy {
  void Reset(const myograde::EpisodeInfo& /*episode*/) override { asked_ = 0; }
  void Act(std::span<const double> observation, std::span<double> action) override {
    ++asked_;
    if (observation[0] > 0.5) GiveUp();
    std::ranges::fill(action, asked_);
  }
  double asked_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::freopen(argv[1], "w", stdout) == nullptr) return 2;
  std::puts("played");
  Impatient policy;
  const int status = myograde::RunPolicy(policy);
  std::puts("goodbye");
  return status;
}
