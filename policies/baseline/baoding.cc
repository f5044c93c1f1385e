// The baseline of the track baoding: the juggler (juggler.h) with the numbers that a search found
// (policies/training), read from baoding.json in the folder that the program is started in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/juggler.h"
#include "policies/baseline/parameter_file.h"

namespace myograde::baseline {

static int Run() {
  return RunBaseline([] {
    return BaselinePolicy<Juggler, kJugglerObservation, kHandActions>(
        "baoding", ReadNumbers("baoding.json", JugglerParameters()));
  });
}

}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
