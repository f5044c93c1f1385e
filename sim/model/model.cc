#include "sim/model/model.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <system_error>

#include <absl/strings/str_cat.h>

#include "protocol/base/file.h"
#include "protocol/base/set_up.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "sim/model/compile.h"
#include "sim/model/file.h"

namespace myograde::sim {
namespace {

namespace fs = std::filesystem;

constexpr size_t kDigestDigits = 64;
constexpr size_t kHugePage = size_t{2} << 20;
constexpr size_t kAlignment = 64;  // of a cache line

size_t RoundUp(size_t size, size_t unit) { return (size + unit - 1) / unit * unit; }

// The gain of a muscle, from its normalised length. MuJoCo 2.2.2 carries the
// curve on below its lower end, where it turns positive and the muscle pushes;
// later versions, and muscles, give nothing there.
mjtNum MuscleGain(const mjModel* model, const mjData* data, int id) {
  enum { kRangeLow, kRangeHigh, kForce, kScale, kLengthMin };
  const mjtNum* parameters = model->actuator_gainprm + mjNGAIN * id;
  const mjtNum* length_range = model->actuator_lengthrange + 2 * id;
  const mjtNum length = data->actuator_length[id];
  const mjtNum rest = (length_range[1] - length_range[0]) /
                      (parameters[kRangeHigh] - parameters[kRangeLow]);
  const mjtNum normalised = parameters[kRangeLow] + (length - length_range[0]) / rest;
  if (normalised < parameters[kLengthMin]) return 0;
  return mju_muscleGain(length, data->actuator_velocity[id], length_range,
                        model->actuator_acc0[id], parameters);
}

// An error inside MuJoCo can't be returned from; the default would write a log
// file into the working folder and exit.
void OnMujocoError(const char* message) {
  std::fprintf(stderr, "MuJoCo: %s\n", message);
  std::fflush(stderr);
  _exit(70);
}

// Warnings are counted in mjData::warning, where the environments look.
void OnMujocoWarning(const char*) {}

// MuJoCo's large blocks in huge pages where the host gives them: a third of a
// simulator's start were page faults. Asked for here, as the C library's own
// way looks at /sys, which a sandbox does not have. A refusal changes nothing.
void* Allocate(size_t size) {
  if (size < kHugePage) return std::aligned_alloc(kAlignment, RoundUp(size, kAlignment));
  size = RoundUp(size, kHugePage);
  void* block = std::aligned_alloc(kHugePage, size);
  if (block != nullptr) madvise(block, size, MADV_HUGEPAGE);
  return block;
}

void InstallCallbacks() {
  static std::once_flag once;
  std::call_once(once, [] {
    mju_user_malloc = Allocate;
    mju_user_free = std::free;
    mjcb_act_gain = MuscleGain;
    mju_user_error = OnMujocoError;
    mju_user_warning = OnMujocoWarning;
  });
}

std::string PackageDir(const std::string& cache_dir) {
  return absl::StrCat(cache_dir, "/myosuite-2.8.4/myosuite");
}

fs::path CompiledPath(const ModelSource& source, const std::string& cache_dir) {
  return fs::path(cache_dir) / "models" /
         absl::StrCat(std::string(source.name), "-", ModelKey(source).substr(0, 16), ".mjb");
}

// A compiled model's file: the SHA-256 of the rest in hexadecimal digits, a
// newline, and MuJoCo's binary model.
std::string Seal(const mjModel* model) {
  std::string body(static_cast<size_t>(mj_sizeModel(model)), '\0');
  mj_saveModel(model, nullptr, body.data(), static_cast<int>(body.size()));
  return absl::StrCat(Sha256Hex(body), "\n", body);
}

absl::StatusOr<ModelPtr> Unseal(std::string_view sealed, const fs::path& path) {
  if (sealed.size() <= kDigestDigits + 1 ||
      sealed.substr(0, kDigestDigits) != Sha256Hex(sealed.substr(kDigestDigits + 1))) {
    return absl::DataLossError(absl::StrCat("compiled model ", path.string(),
                                            " is damaged (wrong SHA-256); delete it and ",
                                            SetUpAdvice()));
  }
  const std::string_view body = sealed.substr(kDigestDigits + 1);
  // Filled by hand, as MuJoCo's own way is a copy of ten megabytes at each
  // lease's start; so it owns nothing, and mj_deleteVFS must not free it.
  auto files = std::make_unique<mjVFS>();
  mj_defaultVFS(files.get());
  files->nfile = 1;
  std::strcpy(files->filename[0], "model.mjb");
  files->filesize[0] = static_cast<int>(body.size());
  files->filedata[0] = const_cast<char*>(body.data());
  ModelPtr model(mj_loadModel("model.mjb", files.get()));
  if (model == nullptr) {
    return absl::DataLossError(
        absl::StrCat("MuJoCo can't load the compiled model ", path.string(), ": delete it"));
  }
  return model;
}

// Writes under another name first, so that no reader ever sees half a model.
absl::Status Store(std::string_view sealed, const fs::path& path) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  const std::string draft = absl::StrCat(path.string(), ".", getpid());
  const bool written = WriteFile(draft, sealed).ok();
  if (written) fs::rename(draft, path, error);
  if (!written || error) {
    std::error_code ignored;
    fs::remove(draft, ignored);
    return absl::UnavailableError(absl::StrCat("can't write the compiled model ", path.string()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<DataPtr> MakeData(const mjModel& model) {
  DataPtr data(mj_makeData(&model));
  if (data == nullptr) return absl::ResourceExhaustedError("no memory for MuJoCo's data");
  return data;
}

absl::StatusOr<ModelPtr> LoadModel(const ModelSource& source, const std::string& cache_dir) {
  InstallCallbacks();
  const std::string package = PackageDir(cache_dir);
  const fs::path path = CompiledPath(source, cache_dir);
  if (auto sealed = MappedFile::Open(path.string()); sealed.ok()) {
    return Unseal(sealed->content(), path);
  }
  ASSIGN_OR_RETURN(auto model, CompileFromSources(source, package));
  // The compiled file only saves time: a cache that can't be written is fine.
  const std::string sealed = Seal(model.get());
  Store(sealed, path).IgnoreError();
  // What was loaded and what was compiled must be the same thing, so both go
  // through the same file.
  return Unseal(sealed, path);
}

bool IsCompiled(const ModelSource& source, const std::string& cache_dir) {
  std::error_code error;
  return fs::exists(CompiledPath(source, cache_dir), error);
}

absl::Status CompileModel(const ModelSource& source, const std::string& cache_dir) {
  InstallCallbacks();
  ASSIGN_OR_RETURN(auto model, CompileFromSources(source, PackageDir(cache_dir)));
  return Store(Seal(model.get()), CompiledPath(source, cache_dir));
}

}  // namespace myograde::sim
