// What the programs of the baselines share: a controller as a policy, and their main().
#pragma once

#include <cstddef>
#include <cstdio>
#include <exception>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "policies/cpp/kit.h"

namespace myograde::baseline {

// Plays `track` with a controller that has Reset() and Act(observation, action) of these sizes and
// gives direct actions. An observation of another track is refused by std::runtime_error.
template <typename Controller, size_t kObservation, size_t kAction>
class BaselinePolicy : public Policy {
 public:
  // `plan`: what the controller is made of.
  template <typename Plan>
  BaselinePolicy(std::string track, const Plan& plan)
      : track_(std::move(track)), controller_(plan) {}

  std::string Name() const override { return "baseline-" + track_; }
  bool Direct() const override { return true; }
  void Reset(const EpisodeInfo&) override { controller_.Reset(); }

  void Act(std::span<const double> observation, std::span<double> action) override {
    if (observation.size() < kObservation || action.size() != kAction) {
      throw std::runtime_error("This policy only plays the track " + track_ + ".");
    }
    controller_.Act(observation.first<kObservation>(), action.first<kAction>());
  }

 protected:
  const Controller& controller() const { return controller_; }
  Controller& controller() { return controller_; }

 private:
  std::string track_;
  Controller controller_;
};

// Plays the policy that `make` returns; the exit status. What it throws is printed.
template <typename Make>
int RunBaseline(const Make& make) {
  try {
    auto policy = make();
    return RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}

}  // namespace myograde::baseline
