// The baseline of the track relocation: the carrier (carrier.h) with the numbers that a search
// found (policies/training), read from relocation.json in the folder that the program is started
// in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/carrier.h"
#include "policies/baseline/parameter_file.h"
#include "policies/baseline/reacher_parameters.h"

int main() {
  using namespace myograde::baseline;
  return RunBaseline([] {
    return BaselinePolicy<Carrier, kCarrierObservation, kArmMuscles>(
        "relocation", MakeCarrierPlan(ReadNumbers("relocation.json", CarrierParameters())));
  });
}
