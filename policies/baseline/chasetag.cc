// The baseline of the track chasetag: the tagger (tagger.h) with numbers (policies/training)
// that are read from chasetag.json in the folder that the program is started in.
#include "policies/baseline/baseline_policy.h"
#include "policies/baseline/parameter_file.h"
#include "policies/baseline/tagger.h"

namespace myograde::baseline {

static int Run() {
  return RunBaseline([] {
    return BaselinePolicy<Tagger, kWholeObservation, kWholeMuscles>(
        "chasetag", ReadNumbers("chasetag.json", TaggerParameters()));
  });
}

}  // namespace myograde::baseline

int main() { return myograde::baseline::Run(); }
