// The baseline of the track relocation: the carrier (carrier.h) with the numbers that a search
// found (policies/training), read from relocation.json in the folder that the program is started
// in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/carrier.h"
#include "policies/baseline/parameter_file.h"
#include "policies/baseline/reacher_parameters.h"

namespace myograde::baseline {

static int Run() {
  return RunBaseline([] {
    return BaselinePolicy<Carrier, kCarrierObservation, kArmMuscles>(
        "relocation", MakeCarrierPlan(ReadNumbers("relocation.json", CarrierParameters())));
  });
}

}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
