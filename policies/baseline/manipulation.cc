// The baseline of the track manipulation: the reacher (reacher.h) with the plan in
// manipulation.json, read from the folder that the program is started in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/reacher.h"
#include "policies/baseline/reacher_parameters.h"

namespace myograde::baseline {

static int Run() {
  return RunBaseline([] {
    return BaselinePolicy<Reacher, kReacherObservation, kReacherAction>(
        "manipulation", ReadReacherPlan("manipulation.json"));
  });
}

}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
