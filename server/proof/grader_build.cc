#include "server/proof/grader_build.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <system_error>
#include <utility>

#include "protocol/base/config_reader.h"
#include "protocol/base/mutex.h"
#include "protocol/base/sha256.h"
#include "server/base/json_value.h"
#include "server/base/paths.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kBuildDigits = 12;  // of SimulatingBuild

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

// The SHA-256 of all files of an adapter, or null. Python's compiled modules follow from the others.
Json AdapterHash(const fs::path& folder) {
  Json files = Json::object();
  std::error_code error;
  fs::recursive_directory_iterator entries(folder, error);
  for (; !error && entries != fs::recursive_directory_iterator(); entries.increment(error)) {
    const fs::path& path = entries->path();
    if (path.filename() == "__pycache__") {
      entries.disable_recursion_pending();
    } else if (entries->is_regular_file(error)) {
      files[path.lexically_relative(folder).string()] = FileHash(path);
    }
  }
  if (error || files.empty()) return nullptr;
  return Sha256Hex(CanonicalJson(files));
}

}  // namespace

std::string GraderVersion() { return MYOGRADE_VERSION; }

nlohmann::json GraderBuild(const std::string& cache_dir,
                           const std::vector<std::string>& adapters) {
  Json models = Json::object();
  std::error_code ignored;  // without the folder there are no compiled models
  for (const fs::directory_entry& entry :
       fs::directory_iterator(cache_dir + "/models", ignored)) {
    if (entry.path().extension() == ".mjb") {
      models[entry.path().filename().string()] = FileHash(entry.path());
    }
  }
  const absl::StatusOr<std::string> bin_dir = BinDir();
  Json build = {{"version", MYOGRADE_VERSION},
                {"simulator", bin_dir.ok() ? FileHash(*bin_dir + "/myograde-sim") : Json()},
                {"mujoco", FileHash(cache_dir + "/mujoco-2.2.2/lib/libmujoco.so.2.2.2")},
                {"models", std::move(models)}};
  for (const std::string& name : adapters) {
    if (name.empty()) continue;
    build["adapters"][name] = bin_dir.ok() ? AdapterHash(AdapterFolder(name, *bin_dir)) : Json();
  }
  return build;
}

bool SameSimulation(const Json& a, const Json& b) {
  for (const char* key : {"simulator", "mujoco"}) {
    if (!At(a, key).is_string() || At(a, key) != At(b, key)) return false;
  }
  const Json& adapters_a = At(a, "adapters");
  const Json& adapters_b = At(b, "adapters");
  for (const auto& [name, hash] : adapters_a.items()) {
    if (At(adapters_b, name) != hash) return false;
  }
  // A model is compiled when it is first needed, so one of the builds may know fewer.
  const Json& models_a = At(a, "models");
  const Json& models_b = At(b, "models");
  if (!models_a.is_object() || !models_b.is_object()) return false;
  return std::all_of(models_a.items().begin(), models_a.items().end(), [&](const auto& model) {
    const auto other = models_b.find(model.key());
    return other == models_b.end() || *other == model.value();
  });
}

std::string SimulatingBuild(std::string_view grader_json) {
  const Json grader = ParsedText(grader_json);
  if (!grader.is_object()) return "";
  Json parts = Json::object();
  for (const char* part : {"simulator", "mujoco", "models"}) {
    parts[part] = grader.value(part, Json());
  }
  return Sha256Hex(CanonicalJson(parts)).substr(0, kBuildDigits);
}

}  // namespace myograde::server
