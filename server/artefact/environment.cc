#include "server/artefact/environment.h"

#include <algorithm>
#include <array>
#include <string_view>

#include <absl/strings/str_cat.h>

#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxVariables = 64;
constexpr size_t kMaxVariableNameBytes = 64;
constexpr size_t kMaxValueBytes = 4096;
constexpr size_t kMaxEnvironmentBytes = 32 << 10;

// An allow list, not a deny list: variables that mean something to the sandbox (PATH, HOME,
// MYOGRADE_*) or to the C library's maths (GLIBC_TUNABLES) stay under the grader's control.
constexpr std::array<std::string_view, 5> kNames = {"CUDA_VISIBLE_DEVICES", "GOTO_NUM_THREADS",
                                                    "LD_LIBRARY_PATH", "MPLCONFIGDIR", "TZ"};
constexpr std::array<std::string_view, 19> kPrefixes = {
    "BLIS_",   "JAX_", "JULIA_", "KERAS_",   "KMP_", "MALLOC_",   "MKL_",
    "MUJOCO_", "NPY_", "NUMBA_", "NUMEXPR_", "OMP_", "OPENBLAS_", "POLICY_",
    "PYTHON",  "PYTORCH_", "TF_", "TORCH_",  "XLA_"};

bool MayBeSet(std::string_view name) {
  const auto begins = [&](std::string_view prefix) { return name.starts_with(prefix); };
  return std::find(kNames.begin(), kNames.end(), name) != kNames.end() ||
         std::any_of(kPrefixes.begin(), kPrefixes.end(), begins);
}

bool IsName(std::string_view name) {
  return !name.empty() && name.size() <= kMaxVariableNameBytes &&
         name.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string_view::npos;
}

std::string Known() {
  std::string list;
  for (const std::string_view name : kNames) absl::StrAppend(&list, std::string(name), ", ");
  for (const std::string_view prefix : kPrefixes) {
    absl::StrAppend(&list, std::string(prefix), "*", prefix == kPrefixes.back() ? "" : ", ");
  }
  return list;
}

}  // namespace

std::map<std::string, std::string> ReadEnvironment(ConfigReader& reader) {
  std::map<std::string, std::string> variables = reader.StringsByName("env");
  size_t bytes = 0;
  for (const auto& [name, value] : variables) {
    if (!IsName(name) || !MayBeSet(name)) {
      reader.Fail("env", absl::StrCat("sets ", Quoted(name), ", which it may not; it may set ",
                                      Known(), " (POLICY_* for names of your own)"));
    }
    if (value.size() > kMaxValueBytes || value.find('\0') != std::string::npos) {
      reader.Fail("env", absl::StrCat("has a value of ", Quoted(name),
                                      " with a zero byte or of more than ", kMaxValueBytes,
                                      " bytes"));
    }
    bytes += name.size() + value.size() + 2;
  }
  if (variables.size() > kMaxVariables || bytes > kMaxEnvironmentBytes) {
    reader.Fail("env", absl::StrCat("must have at most ", kMaxVariables, " variables and ",
                                    kMaxEnvironmentBytes, " bytes together"));
  }
  return variables;
}

}  // namespace myograde::server
