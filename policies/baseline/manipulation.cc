// The baseline of the track manipulation: the reacher (reacher.h) with the plan in
// manipulation.json, read from the folder that the program is started in.
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>

#include "policies/baseline/reacher.h"
#include "policies/baseline/reacher_parameters.h"
#include "policies/cpp/kit.h"

namespace {

using myograde::baseline::kReacherAction;
using myograde::baseline::kReacherObservation;

class Baseline : public myograde::Policy {
 public:
  explicit Baseline(const myograde::baseline::ReacherPlan& plan) : reacher_(plan) {}

  std::string Name() const override { return "baseline-manipulation"; }
  bool Direct() const override { return true; }
  void Reset(const myograde::EpisodeInfo&) override { reacher_.Reset(); }

  void Act(std::span<const double> observation, std::span<double> action) override {
    if (observation.size() < kReacherObservation || action.size() != kReacherAction) {
      throw std::runtime_error("This policy only plays the track manipulation.");
    }
    reacher_.Act(observation.first<kReacherObservation>(), action.first<kReacherAction>());
  }

 private:
  myograde::baseline::Reacher reacher_;
};

}  // namespace

int main() {
  try {
    Baseline policy(myograde::baseline::ReadReacherPlan("manipulation.json"));
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
