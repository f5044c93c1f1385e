// The baseline of the track locomotion: the walker (walker.h) with the numbers that a search found
// (policies/training), read from locomotion.json in the folder that the program is started in.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "policies/baseline/parameter_file.h"
#include "policies/baseline/walker.h"
#include "policies/cpp/kit.h"

namespace {

using myograde::baseline::kWalkerAction;
using myograde::baseline::kWalkerObservation;

class Baseline : public myograde::Policy {
 public:
  explicit Baseline(const myograde::baseline::WalkerNumbers& numbers) : walker_(numbers) {}

  std::string Name() const override { return "baseline-locomotion"; }
  bool Direct() const override { return true; }

  // Each set is one impedance: its states are all the same, and a load that never is leaves them.
  std::vector<myograde::leg_parameter_set_t> LegSets() const override {
    std::vector<myograde::leg_parameter_set_t> sets;
    for (const auto& mode : walker_.LegModes()) {
      myograde::leg_state_t state;
      state.knee_stiffness = mode.knee_stiffness;
      state.knee_damping = mode.knee_damping;
      state.knee_target = mode.knee_target;
      state.ankle_stiffness = mode.ankle_stiffness;
      state.ankle_damping = mode.ankle_damping;
      state.ankle_target = mode.ankle_target;
      state.thresholds = {{}};
      state.thresholds[0].quantity = 0;  // the load, in N
      state.thresholds[0].above = 0;
      state.thresholds[0].value = -1e9;
      state.num_thresholds = 1;
      myograde::leg_parameter_set_t& set = sets.emplace_back();
      set.index = static_cast<int8_t>(sets.size() - 1);
      std::ranges::fill(set.states, state);
    }
    return sets;
  }

  void Start(const myograde::welcome_t& welcome) override {
    walker_.Expect(myograde::baseline::ObservedIn(welcome.profile));
  }

  void Reset(const myograde::EpisodeInfo&) override { walker_.Reset(); }

  void Act(std::span<const double> observation, std::span<double> action) override {
    if (observation.size() < kWalkerObservation || action.size() != kWalkerAction) {
      throw std::runtime_error("This policy only plays the track locomotion.");
    }
    walker_.Act(observation.first<kWalkerObservation>(), action.first<kWalkerAction>());
  }

 private:
  myograde::baseline::Walker walker_;
};

}  // namespace

int main() {
  try {
    Baseline policy(myograde::baseline::ReadWalkerNumbers("locomotion.json"));
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
