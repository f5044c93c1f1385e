#include "protocol/base/pinned_maths.h"

#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include <absl/strings/str_cat.h>

namespace myograde {

absl::Status PinMaths(char** argv) {
  const char* tunables = std::getenv(kTunablesVariable);
  if (tunables != nullptr && IsPinned(tunables)) return absl::OkStatus();
  setenv(kTunablesVariable, kPinnedTunables, /*overwrite=*/1);
  execv("/proc/self/exe", argv);
  return absl::InternalError(absl::StrCat("can't start again with ", kTunablesVariable, "=",
                                          kPinnedTunables, ": ", std::strerror(errno)));
}

}  // namespace myograde
