#include "server/runtime/runtimes.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/set_up.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr size_t kLongestName = 64;
constexpr size_t kLargestFile = 4u << 20;  // of runtime.json
constexpr int64_t kMany = int64_t{1} << 50;
// Where earlier releases put versions that were replaced; no runtime can be called that.
constexpr char kFormerFolder[] = ".former";
// In the names of versions' folders, and in no runtime's name.
constexpr char kVersionMark = '@';

absl::Status ReadPackages(const Json& list, const std::string& where, Runtime& runtime) {
  for (const Json& entry : list) {
    ConfigReader reader(entry, where);
    RuntimePackage package{reader.String("name"), reader.String("version"),
                           reader.Choice("source", {"pypi", "debian"})};
    reader.Ignore("sha256");
    RETURN_IF_ERROR(reader.Finish());
    runtime.packages.push_back(std::move(package));
  }
  return absl::OkStatus();
}

// The folder of the version that `path` stands for now: what it leads to, if it is a link to
// something beside it, and else `path` (as earlier releases had it, and folders of server.json).
std::string VersionFolder(const fs::path& path) {
  std::error_code error;
  const fs::path target = fs::read_symlink(path, error);
  if (error || target.has_parent_path()) return path;
  return path.parent_path() / target;
}

// A folder of server.json: its content is known only if it was made by `myograde runtime add`.
absl::StatusOr<Runtime> Configured(const std::string& name, const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    return absl::InternalError(absl::StrCat("the runtime \"", name, "\" has no folder ", folder,
                                            "; ", SetUpAdvice(),
                                            ", or fix runtimes in server.json"));
  }
  const std::string version = VersionFolder(folder);
  absl::StatusOr<Runtime> runtime = ReadRuntime(version);
  if (absl::IsNotFound(runtime.status())) runtime = Runtime{.folder = version};
  if (!runtime.ok()) return absl::InternalError(runtime.status().message());
  runtime->name = name;
  runtime->configured = true;
  return runtime;
}

constexpr ArtefactLimits kAny = {
    .bytes = int64_t{1} << 50, .files = int64_t{1} << 40, .depth = 4096, .name_bytes = 255};

absl::Status Unreadable(const fs::path& path, const std::string& why) {
  return absl::InternalError(absl::StrCat(path.string(), ": can't be read: ", why));
}

absl::Status AddEntry(const fs::directory_entry& found, const std::string& path, Listing& listing) {
  std::error_code error;
  const fs::file_status status = found.symlink_status(error);
  const EntryType type = fs::is_symlink(status)     ? EntryType::kLink
                         : fs::is_directory(status) ? EntryType::kFolder
                                                    : EntryType::kFile;
  if (type == EntryType::kFile && !fs::is_regular_file(status)) {
    return Unreadable(found.path(), "it is not a file, folder or link");
  }
  const absl::StatusOr<Entry*> entry = listing.Add(path, type);
  if (!entry.ok()) return Unreadable(found.path(), std::string(entry.status().message()));
  if (type == EntryType::kLink) {
    (*entry)->target = fs::read_symlink(found.path(), error).string();
  } else if (type == EntryType::kFile) {
    absl::StatusOr<std::string> sha256 = Sha256File(found.path());
    if (!sha256.ok()) return Unreadable(found.path(), std::string(sha256.status().message()));
    (*entry)->sha256 = *std::move(sha256);
    (*entry)->executable = (status.permissions() & fs::perms::owner_exec) != fs::perms::none;
    (*entry)->size = static_cast<int64_t>(found.file_size(error));
    if (!error) return listing.AddBytes(path, (*entry)->size);
  }
  return error ? Unreadable(found.path(), error.message()) : absl::OkStatus();
}

}  // namespace

bool IsRuntimeName(std::string_view name) {
  return !name.empty() && name.size() <= kLongestName && std::string_view("._-").find(name[0]) ==
                                                             std::string_view::npos &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789._-") ==
             std::string_view::npos;
}

absl::StatusOr<Runtime> ReadRuntime(const std::string& folder) {
  const std::string path = absl::StrCat(folder, "/", kRuntimeFile);
  std::error_code error;
  if (!fs::exists(fs::symlink_status(path, error))) {
    return absl::NotFoundError(absl::StrCat(path, ": is not there"));
  }
  const absl::StatusOr<Json> json = ReadJsonFile(path, kLargestFile);
  if (!json.ok()) return absl::InvalidArgumentError(json.status().message());
  ConfigReader reader(*json, path);
  reader.Integer("format", 1, 1);
  Runtime runtime{.name = reader.String("runtime"),
                  .folder = folder,
                  .digest = reader.String("digest"),
                  .python = reader.String("python"),
                  .made_at = reader.String("made_at"),
                  .bytes = reader.Integer("bytes", 0, kMany),
                  .files = reader.Integer("files", 0, kMany)};
  reader.Ignore("made_from");
  const Json packages = reader.Array("packages");
  if (!IsSha256Hex(runtime.digest)) reader.Fail("digest", "is not a SHA-256");
  if (!IsRuntimeName(runtime.name)) reader.Fail("runtime", "is not a name of a runtime");
  absl::Status status = reader.Finish();
  if (status.ok()) status = ReadPackages(packages, path + ": packages", runtime);
  if (!status.ok()) return absl::InvalidArgumentError(status.message());
  return runtime;
}

std::vector<Runtime> Runtimes::List() const {
  std::vector<Runtime> all;
  const auto add = [&](absl::StatusOr<Runtime> runtime) {
    if (runtime.ok()) all.push_back(*std::move(runtime));
  };
  for (const auto& [name, folder] : configured_) add(Configured(name, folder));
  std::error_code error;
  if (!dir_.empty()) {
    for (const fs::directory_entry& entry : fs::directory_iterator(dir_, error)) {
      const std::string name = entry.path().filename().string();
      if (!IsRuntimeName(name) || configured_.contains(name)) continue;
      add(Find(name));
    }
  }
  std::sort(all.begin(), all.end(),
            [](const Runtime& a, const Runtime& b) { return a.name < b.name; });
  return all;
}

absl::StatusOr<Runtime> Runtimes::Find(const std::string& name) const {
  const auto found = configured_.find(name);
  if (found != configured_.end()) return Configured(name, found->second);
  const absl::Status none = absl::NotFoundError(absl::StrCat("there is no runtime \"", name, "\""));
  if (dir_.empty() || !IsRuntimeName(name)) return none;
  absl::StatusOr<Runtime> runtime = ReadRuntime(VersionFolder(fs::path(dir_) / name));
  if (absl::IsNotFound(runtime.status())) return none;
  if (!runtime.ok()) return absl::InternalError(runtime.status().message());
  runtime->name = name;
  return runtime;
}

absl::StatusOr<Runtime> Runtimes::Find(const std::string& name, const std::string& digest) const {
  absl::StatusOr<Runtime> present = Find(name);
  if (present.ok() && present->digest == digest) return present;
  for (const auto& [folder, version] : Versions()) {
    if (version.name == name && version.digest == digest) return version;
  }
  const std::string now = !present.ok() ? "is no longer there"
                          : present->digest.empty()
                              ? "has an unknown content now"
                              : absl::StrCat("is ", present->digest.substr(0, 12), " now");
  return absl::NotFoundError(absl::StrCat("the runtime \"", name, "\" of the digest ",
                                          digest.substr(0, 12), " is gone: \"", name, "\" ", now));
}

std::map<std::string, Runtime> Runtimes::Versions() const {
  std::map<std::string, Runtime> all;
  if (dir_.empty()) return all;
  for (const std::string& folder : {dir_, absl::StrCat(dir_, "/", kFormerFolder)}) {
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
      const fs::path& path = entry.path();
      if (path.filename().string().find(kVersionMark) == std::string::npos) continue;
      absl::StatusOr<Runtime> runtime = ReadRuntime(path);
      if (runtime.ok()) all[path] = *std::move(runtime);
    }
  }
  return all;
}

std::vector<Runtime> Runtimes::Former() const {
  std::map<std::string, Runtime> versions = Versions();
  for (const Runtime& present : List()) versions.erase(present.folder);
  std::vector<Runtime> all;
  for (auto& [folder, version] : versions) all.push_back(std::move(version));
  return all;
}

absl::Status CheckRuntime(const Runtime& runtime) {
  if (runtime.digest.empty()) return absl::OkStatus();
  Listing listing(kAny);
  std::error_code error;
  fs::recursive_directory_iterator found(runtime.folder, error);
  for (; !error && found != fs::recursive_directory_iterator(); found.increment(error)) {
    const std::string path = found->path().lexically_relative(runtime.folder).string();
    if (path == kRuntimeFile) continue;
    RETURN_IF_ERROR(AddEntry(*found, path, listing));
  }
  if (error) return Unreadable(runtime.folder, error.message());
  const std::string digest = listing.Digest();
  if (digest == runtime.digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(
      runtime.folder, ": was changed: its files have the digest ", digest.substr(0, 12),
      ", and it was made with ", runtime.digest.substr(0, 12)));
}

nlohmann::json RuntimeDigests(const Runtimes& runtimes, const std::vector<std::string>& names) {
  Json digests = Json::object();
  for (const std::string& name : names) {
    const absl::StatusOr<Runtime> runtime = runtimes.Find(name);
    if (runtime.ok() && !runtime->digest.empty()) digests[name] = runtime->digest;
  }
  return digests;
}

nlohmann::json RuntimeDigests(const Runtimes& runtimes) {
  std::vector<std::string> names;
  for (const Runtime& runtime : runtimes.List()) names.push_back(runtime.name);
  return RuntimeDigests(runtimes, names);
}

nlohmann::json WithRuntimes(nlohmann::json grader, nlohmann::json digests) {
  if (!digests.empty()) grader["runtimes"] = std::move(digests);
  return grader;
}

nlohmann::json RuntimeToJson(const Runtime& runtime) {
  const bool known = !runtime.digest.empty();
  Json packages = Json::array();
  for (const RuntimePackage& package : runtime.packages) {
    packages.push_back({{"name", package.name}, {"version", package.version},
                        {"source", package.source}});
  }
  return {{"runtime", runtime.name},
          {"digest", known ? Json(runtime.digest) : Json()},
          {"python", known ? Json(runtime.python) : Json()},
          {"made_at", known ? Json(runtime.made_at) : Json()},
          {"bytes", known ? Json(runtime.bytes) : Json()},
          {"files", known ? Json(runtime.files) : Json()},
          {"packages", std::move(packages)}};
}

}  // namespace myograde::server
