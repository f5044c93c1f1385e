// What MuJoCo has warned of since the counters were last cleared.
#pragma once

#include <algorithm>
#include <initializer_list>

#include <mujoco/mujoco.h>

namespace myograde::sim {

// True if it has warned of any of these kinds.
inline bool Warned(const mjData& data, std::initializer_list<mjtWarning> kinds) {
  return std::any_of(kinds.begin(), kinds.end(),
                     [&](mjtWarning kind) { return data.warning[kind].number > 0; });
}

// A buffer was too small: contacts or constraints were left out.
inline bool Overflown(const mjData& data) {
  return Warned(data, {mjWARN_CONTACTFULL, mjWARN_CNSTRFULL});
}

// A position, velocity or acceleration was not finite or far too large.
inline bool BadNumbers(const mjData& data) {
  return Warned(data, {mjWARN_BADQPOS, mjWARN_BADQVEL, mjWARN_BADQACC});
}

}  // namespace myograde::sim
