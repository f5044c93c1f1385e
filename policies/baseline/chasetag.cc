// The baseline of the track chasetag: the tagger (tagger.h) with numbers (policies/training)
// that are read from chasetag.json in the folder that the program is started in.
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <string>
#include <vector>

#include "policies/baseline/parameter_file.h"
#include "policies/baseline/tagger.h"
#include "policies/cpp/kit.h"

namespace {

using myograde::baseline::kWholeMuscles;
using myograde::baseline::kWholeObservation;

class Baseline : public myograde::Policy {
 public:
  explicit Baseline(const std::vector<double>& numbers) : tagger_(numbers) {}

  std::string Name() const override { return "baseline-chasetag"; }
  bool Direct() const override { return true; }
  void Reset(const myograde::EpisodeInfo&) override { tagger_.Reset(); }

  void Act(std::span<const double> observation, std::span<double> action) override {
    if (observation.size() < kWholeObservation || action.size() != kWholeMuscles) {
      throw std::runtime_error("This policy only plays the track chasetag.");
    }
    tagger_.Act(observation.first<kWholeObservation>(), action.first<kWholeMuscles>());
  }

 private:
  myograde::baseline::Tagger tagger_;
};

}  // namespace

int main() {
  try {
    Baseline policy(
        myograde::baseline::ReadNumbers("chasetag.json", myograde::baseline::TaggerParameters()));
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
