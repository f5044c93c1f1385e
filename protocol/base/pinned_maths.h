// The C library selects its maths functions by the processor's features, and its variants differ in
// the last bits. This environment variable makes every host select the same ones; every program
// that compiles a model or simulates runs with it.
#pragma once

#include <string_view>

#include <absl/status/status.h>

namespace myograde {

inline constexpr char kTunablesVariable[] = "GLIBC_TUNABLES";
inline constexpr char kPinnedTunables[] =
    "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX";

// True if `tunables` switches off at least the features that kPinnedTunables does.
inline bool IsPinned(std::string_view tunables) {
  constexpr std::string_view kHwcaps = "glibc.cpu.hwcaps=";
  const size_t begin = tunables.find(kHwcaps);
  if (begin == std::string_view::npos) return false;
  std::string_view off = tunables.substr(begin + kHwcaps.size());
  off = off.substr(0, off.find(':'));
  const auto holds = [off](std::string_view feature) {
    for (size_t at = 0; at <= off.size();) {
      const size_t end = off.find(',', at);
      if (off.substr(at, end == std::string_view::npos ? end : end - at) == feature) return true;
      if (end == std::string_view::npos) return false;
      at = end + 1;
    }
    return false;
  };
  for (const char* feature : {"-AVX2", "-FMA", "-FMA4", "-AVX512F", "-AVX512VL", "-AVX"}) {
    if (!holds(feature)) return false;
  }
  return true;
}

// Re-executes this program with `argv` unless its maths is pinned already, as the C library selects
// before main. Returns only if there is nothing to do or it fails.
absl::Status PinMaths(char** argv);

}  // namespace myograde
