// Uniform random actions inside the bounds of every entry, repeatable: the
// numbers are drawn from the episode's policy seed and nothing else.
#include <cmath>
#include <random>

#include "policies/cpp/kit.h"

namespace {

class Random : public myograde::Policy {
 public:
  std::string Name() const override { return "random"; }

  void Start(const myograde::welcome_t& welcome) override {
    low_ = welcome.action_low;
    high_ = welcome.action_high;
    selects_leg_set_ = welcome.track == "locomotion";
  }

  void Reset(const myograde::EpisodeInfo& episode) override { bits_.seed(episode.policy_seed); }

  void Act(std::span<const double>, std::span<double> action) override {
    for (size_t i = 0; i < action.size(); ++i) {
      // The standard fixes the engine's bits but not its distributions', so
      // the 53-bit uniform number is made here.
      const double uniform = static_cast<double>(bits_() >> 11) * 0x1.0p-53;
      action[i] = low_[i] + (high_[i] - low_[i]) * uniform;
    }
    if (selects_leg_set_) action.back() = std::floor(action.back() + 0.5);
  }

 private:
  std::mt19937_64 bits_;
  std::vector<double> low_, high_;
  bool selects_leg_set_ = false;
};

}  // namespace

int main() {
  Random policy;
  return myograde::RunPolicy(policy);
}
