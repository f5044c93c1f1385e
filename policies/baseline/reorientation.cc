// The baseline of the track reorientation: the turner (turner.h) with the turns that a search found
// (policies/training), read from reorientation.json in the folder that the program is started in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/turner.h"

namespace myograde::baseline {

static int Run() {
  return RunBaseline([] {
    return BaselinePolicy<Turner, kTurnerObservation, kHandActions>(
        "reorientation", ReadTurns("reorientation.json"));
  });
}

}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
