// The baseline of the track baoding: the juggler (juggler.h) with the numbers that a search found
// (policies/training), read from baoding.json in the folder that the program is started in.
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "policies/baseline/juggler.h"
#include "policies/baseline/parameter_file.h"
#include "policies/cpp/kit.h"

namespace {

using myograde::baseline::kHandActions;
using myograde::baseline::kJugglerObservation;

class Baseline : public myograde::Policy {
 public:
  explicit Baseline(const std::vector<double>& numbers) : juggler_(numbers) {}

  std::string Name() const override { return "baseline-baoding"; }
  bool Direct() const override { return true; }
  void Reset(const myograde::EpisodeInfo&) override { juggler_.Reset(); }

  void Act(std::span<const double> observation, std::span<double> action) override {
    if (observation.size() < kJugglerObservation || action.size() != kHandActions) {
      throw std::runtime_error("This policy only plays the track baoding.");
    }
    juggler_.Act(observation.first<kJugglerObservation>(), action.first<kHandActions>());
  }

 private:
  myograde::baseline::Juggler juggler_;
};

}  // namespace

int main() {
  try {
    Baseline policy(
        myograde::baseline::ReadNumbers("baoding.json", myograde::baseline::JugglerParameters()));
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
