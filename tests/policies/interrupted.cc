// A policy that a timer's signal interrupts a thousand times a second. It throws once the first
// entry of an observation is above 0.5, and main ends with 5 where that exception arrives.
#include <sys/time.h>

#include <csignal>
#include <stdexcept>

#include "policies/cpp/kit.h"

namespace {

class Throws : public myograde::Policy {
  void Act(std::span<const double> observation, std::span<double>) override {
    if (observation[0] > 0.5) throw std::runtime_error("for a test");
  }
};

}  // namespace

int main() {
  struct sigaction action = {};
  action.sa_handler = [](int) {};
  sigaction(SIGALRM, &action, nullptr);
  const itimerval often = {{0, 1000}, {0, 1000}};
  setitimer(ITIMER_REAL, &often, nullptr);
  Throws policy;
  try {
    return myograde::RunPolicy(policy);
  } catch (const std::runtime_error&) {
    return 5;
  }
}
