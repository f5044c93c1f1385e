// The baseline of the track locomotion: the walker (walker.h) with the numbers that a search found
// (policies/training), read from locomotion.json in the folder that the program is started in.
#include <algorithm>
#include <vector>

#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/parameter_file.h"
#include "policies/baseline/walker.h"

namespace myograde::baseline {
namespace {

class WalkerPolicy : public BaselinePolicy<Walker, kWalkerObservation, kWalkerAction> {
 public:
  using BaselinePolicy::BaselinePolicy;

  // Each set is one impedance: its states are all the same, and a load that never is leaves them.
  std::vector<leg_parameter_set_t> LegSets() const override {
    std::vector<leg_parameter_set_t> sets;
    for (const auto& mode : controller().LegModes()) {
      leg_state_t state;
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
      leg_parameter_set_t& set = sets.emplace_back();
      set.index = static_cast<int8_t>(sets.size() - 1);
      std::ranges::fill(set.states, state);
    }
    return sets;
  }

  void Start(const welcome_t& welcome) override {
    controller().Expect(ObservedIn(welcome.profile));
  }
};

int Run() {
  return RunBaseline(
      [] { return WalkerPolicy("locomotion", ReadWalkerNumbers("locomotion.json")); });
}

}  // namespace
}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
