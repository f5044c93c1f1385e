// Does nothing: every muscle off (-1), the prosthesis in the middle of its
// ranges, the leg's parameter set 0.
#include <algorithm>

#include "policies/cpp/kit.h"

namespace {

class Zero : public myograde::Policy {
 public:
  std::string Name() const override { return "zero"; }

  void Start(const myograde::welcome_t& welcome) override {
    muscles_ = welcome.track == "manipulation" ? 63 : 54;
  }

  void Act(std::span<const double>, std::span<double> action) override {
    std::ranges::fill(action.first(muscles_), -1.0);
  }

 private:
  size_t muscles_ = 0;
};

}  // namespace

int main() {
  Zero policy;
  return myograde::RunPolicy(policy);
}
