// A policy that plays every track, and as yet does little: its muscles twitch at random. Replace
// what Act does.
#include <myograde/kit.h>

#include <cstdio>
#include <exception>
#include <random>

namespace {

class MyPolicy : public myograde::Policy {
 public:
  // For logs.
  std::string Name() const override { return "@NAME@"; }

  // False: every entry of an action is normalized to [-1, 1]. True: muscles in [0, 1], targets of
  // a prosthesis in rad.
  bool Direct() const override { return false; }

  // Called once. The welcome tells the track, the parts of both vectors by name, and the bounds of
  // every entry; "myograde spec" prints what they mean. What is printed is shown with the result.
  void Start(const myograde::welcome_t& welcome) override {
    welcome_ = welcome;
    std::fprintf(stderr, "track %s, profile %s\n", welcome.track.c_str(), welcome.profile.c_str());
    Print("observation", welcome.observation_parts);
    Print("action", welcome.action_parts);
  }

  // Called at the beginning of each episode. Randomness from the policy seed alone makes a policy
  // play the same whenever it is graded again.
  void Reset(const myograde::EpisodeInfo& episode) override { random_.seed(episode.policy_seed); }

  // Called for each step: fills `action`, which comes with zeros. GiveUp() would end the episode.
  void Act(std::span<const double> observation, std::span<double> action) override {
    // Activations of the muscles; `observation` has the other parts as well.
    const std::span<const double> active = PartOf(observation, welcome_.observation_parts, "act");
    const std::span<double> muscles = PartOf(action, welcome_.action_parts, "muscles");
    std::uniform_real_distribution<double> twitch(-1.0, 0.2);
    for (size_t i = 0; i < muscles.size(); ++i) {
      muscles[i] = i < active.size() && active[i] > 0.5 ? -1.0 : twitch(random_);
    }
  }

 private:
  static void Print(const char* vector, const std::vector<myograde::part_t>& parts) {
    for (const myograde::part_t& part : parts) {
      std::fprintf(stderr, "%s: %s from %d, size %d, unit %s\n", vector, part.name.c_str(),
                   part.offset, part.size, part.unit.c_str());
    }
  }

  myograde::welcome_t welcome_;
  std::mt19937_64 random_;
};

}  // namespace

int main() {
  MyPolicy policy;
  try {
    return myograde::RunPolicy(policy);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
