// The zero action: every entry is 0. What a policy must beat.
#include "policies/cpp/kit.h"

namespace {

class Zero : public myograde::Policy {
 public:
  std::string Name() const override { return "zero"; }
  void Act(std::span<const double>, std::span<double>) override {}  // `action` comes as zeros
};

}  // namespace

int main() {
  Zero policy;
  return myograde::RunPolicy(policy);
}
