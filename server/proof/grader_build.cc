#include "server/proof/grader_build.h"

#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include "protocol/base/mutex.h"
#include "protocol/base/sha256.h"
#include "server/base/paths.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// The SHA-256 of a file, or null. Cached until the file changes, as every submission asks for it.
Json FileHash(const fs::path& path) {
  struct Known {
    fs::file_time_type changed;
    uintmax_t size;
    std::string hash;
  };
  static Mutex mutex;
  static std::map<fs::path, Known> known ABSL_GUARDED_BY(mutex);
  std::error_code error;
  const fs::file_time_type changed = fs::last_write_time(path, error);
  const uintmax_t size = error ? 0 : fs::file_size(path, error);
  if (error) return nullptr;
  const MutexLock lock(mutex);
  const auto it = known.find(path);
  if (it != known.end() && it->second.changed == changed && it->second.size == size) {
    return it->second.hash;
  }
  absl::StatusOr<std::string> hash = Sha256File(path);
  if (!hash.ok()) return nullptr;
  known[path] = {changed, size, *hash};
  return *std::move(hash);
}

}  // namespace

std::string GraderVersion() { return MYOGRADE_VERSION; }

nlohmann::json GraderBuild(const std::string& cache_dir) {
  Json models = Json::object();
  std::error_code ignored;  // without the folder there are no compiled models
  for (const fs::directory_entry& entry :
       fs::directory_iterator(cache_dir + "/models", ignored)) {
    if (entry.path().extension() == ".mjb") {
      models[entry.path().filename().string()] = FileHash(entry.path());
    }
  }
  const absl::StatusOr<std::string> bin_dir = BinDir();
  return {{"version", MYOGRADE_VERSION},
          {"simulator", bin_dir.ok() ? FileHash(*bin_dir + "/myograde-sim") : Json()},
          {"mujoco", FileHash(cache_dir + "/mujoco-2.2.2/lib/libmujoco.so.2.2.2")},
          {"models", std::move(models)}};
}

}  // namespace myograde::server
