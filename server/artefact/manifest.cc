#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <set>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/artefact/artefact.h"
#include "server/artefact/listing.h"
#include "server/artefact/submission.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxManifestBytes = 64 << 10;
constexpr size_t kMaxNameBytes = 64;
constexpr size_t kMaxArguments = 256;
constexpr size_t kMaxArgumentBytes = 4096;
constexpr size_t kMaxRuntimes = 8;
constexpr int kMaxLinkHops = 16;
constexpr size_t kMaxVariables = 64;
constexpr size_t kMaxVariableNameBytes = 64;
constexpr size_t kMaxValueBytes = 4096;
constexpr size_t kMaxEnvironmentBytes = 32 << 10;

// An allow list, not a deny list: variables that mean something to the sandbox (PATH, HOME,
// MYOGRADE_*) or to the C library's maths (GLIBC_TUNABLES) stay under the grader's control.
constexpr const char* kNames[] = {"CUDA_VISIBLE_DEVICES", "GOTO_NUM_THREADS", "LD_LIBRARY_PATH",
                                  "MPLCONFIGDIR", "TZ"};
constexpr const char* kPrefixes[] = {
    "BLIS_",   "JAX_",     "JULIA_", "KERAS_",   "KMP_", "MALLOC_",   "MKL_",
    "MUJOCO_", "NPY_",     "NUMBA_", "NUMEXPR_", "OMP_", "OPENBLAS_", "POLICY_",
    "PYTHON",  "PYTORCH_", "TF_",    "TORCH_",   "XLA_"};

bool MayBeSet(std::string_view name) {
  if (name.empty() || name.size() > kMaxVariableNameBytes ||
      name.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") != std::string_view::npos) {
    return false;
  }
  return std::ranges::any_of(kNames, [&](const char* known) { return name == known; }) ||
         std::ranges::any_of(kPrefixes, [&](const char* begin) { return name.starts_with(begin); });
}

std::string Known() {
  return absl::StrCat(absl::StrJoin(kNames, ", "), ", ", absl::StrJoin(kPrefixes, "*, "), "*");
}

// "policy.json is missing", with the folder that contains it if somebody packed a folder instead of
// its content.
absl::Status MissingManifest(int root) {
  std::string hint;
  const auto has = [&](const std::string& path) { return OpenBeneath(root, path, O_PATH).valid(); };
  if (has(".dockerenv") || (has("usr/bin") && has("etc"))) {
    hint = "; it looks like the files of a container, as written by \"docker export\", without "
           "the image's configuration: save the image, with \"docker save\" or \"podman save\"";
  }
  if (has("index.json") && has("blobs")) {
    hint = "; it looks like a container image in OCI's layout that is not a tar, or lacks the file oci-layout: "
           "write it with podman save, docker save or buildah push IMAGE oci-archive:FILE.tar";
  }
  for (const std::string& folder : NamesIn(root).value_or(std::vector<std::string>())) {
    if (folder.starts_with('.')) continue;
    if (has(folder + "/policy.json")) {
      hint = absl::StrCat("; it is at ", Quoted(folder + "/policy.json"),
                          "; submit that folder itself");
    } else if (has(folder + "/index.json") || has(folder + "/manifest.json")) {
      hint = absl::StrCat("; the folder ", Quoted(folder),
                          " looks like a container image: pack its contents, not the folder, with "
                          "\"tar -C ",
                          folder, " -cf image.tar .\"");
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      "there is no policy.json at the top of the submission",
      hint.empty() ? "; add one: {\"name\": \"my policy\", \"command\": [\"./policy\"]}" : hint));
}

absl::StatusOr<std::string> ReadManifestText(int root) {
  const Fd fd = OpenBeneath(root, "policy.json", O_RDONLY | O_NONBLOCK);
  if (!fd.valid() && errno == ENOENT) return MissingManifest(root);
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError("policy.json must be a readable file, not a link");
  }
  ASSIGN_OR_RETURN(std::string text, ReadAll(fd.get(), "policy.json", kMaxManifestBytes));
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff") ||
      text.find('\0') != std::string::npos) {
    return absl::InvalidArgumentError(
        "policy.json is not UTF-8; it may be UTF-16, as some Windows programs write; save it as "
        "UTF-8 (in PowerShell: Set-Content -Encoding utf8)");
  }
  return text;
}

absl::Status BadCommand(std::string_view command, absl::string_view rule) {
  return absl::InvalidArgumentError(
      absl::StrCat("policy.json: \"command\" starts with ", Quoted(command), ", which ", rule));
}

// Resolves the links of a relative command by hand: an absolute target belongs to the sandbox,
// whose files are unknown here, and ends the search.
absl::Status CheckProgram(int root, const std::string& command) {
  std::string path = std::filesystem::path(command).lexically_normal().string();
  for (int hop = 0; hop < kMaxLinkHops; ++hop) {
    if (path.empty() || path == "." || path == ".." || path.starts_with("../")) {
      return BadCommand(command, "is not a file inside the submission");
    }
    const Fd fd = OpenBeneath(root, path, O_PATH);
    struct stat info = {};
    if (!fd.valid() || ::fstat(fd.get(), &info) != 0) {
      return BadCommand(command, errno == ELOOP ?
                        "goes through a symbolic link to a folder; give the program's real path"
                                                : "does not exist; give a file of the submission, "
                                                  "or a program of the sandbox such as python3");
    }
    if (S_ISREG(info.st_mode)) {
      const Fd file = OpenBeneath(root, path, O_RDONLY | O_NONBLOCK);
      if (file.valid() && ReadProgramHead(file.get()).windows_line_end) {
        return BadCommand(command, kWindowsLineEnds);
      }
      if ((info.st_mode & 0111) != 0) return absl::OkStatus();
      return BadCommand(command, "is not executable; set its bit with chmod +x");
    }
    if (!S_ISLNK(info.st_mode)) return BadCommand(command, "is a folder, not a program");
    const std::string target = TargetOf(fd.get());
    if (target.empty()) return BadCommand(command, "is a symbolic link that can't be read");
    if (target.starts_with('/')) return absl::OkStatus();
    path = (std::filesystem::path(path).parent_path() / target).lexically_normal().string();
  }
  return BadCommand(command, "is a loop of symbolic links");
}

void CheckName(ConfigReader& reader, const std::string& name) {
  if (const std::string harm = FirstUnsafe(name); !harm.empty()) {
    reader.Fail("name", absl::StrCat("has ", harm, ", which is invisible or changes how other "
                                     "characters look; leave it out"));
  } else if (!IsPlainText(name, kMaxNameBytes)) {
    reader.Fail("name", absl::StrCat("must have 1 to ", kMaxNameBytes,
                                     " bytes, without a space at either end"));
  }
}

void CheckCommand(ConfigReader& reader, const std::vector<std::string>& command) {
  if (command.empty() || command.size() > kMaxArguments) {
    reader.Fail("command", absl::StrCat("must be the program and its arguments: 1 to ",
                                        kMaxArguments, " strings"));
    return;
  }
  for (const std::string& argument : command) {
    if (argument.size() > kMaxArgumentBytes || argument.find('\0') != std::string::npos) {
      reader.Fail("command", absl::StrCat("has a string with a zero byte or of more than ",
                                          kMaxArgumentBytes, " bytes"));
    }
  }
  if (command[0].empty()) reader.Fail("command", "starts with an empty string");
}

// A bare word means a file of the submission if there is one of that name, else a program in the
// sandbox's PATH.
void NameOwnProgram(int root, std::string& program) {
  if (program.find('/') != std::string::npos) return;
  const Fd fd = OpenBeneath(root, program, O_PATH);
  struct stat info = {};
  if (fd.valid() && ::fstat(fd.get(), &info) == 0 && !S_ISDIR(info.st_mode)) {
    program = "./" + program;
  }
}

void CheckRuntimes(ConfigReader& reader, const std::vector<std::string>& runtimes) {
  std::set<std::string> seen;
  for (const std::string& runtime : runtimes) {
    const bool good = !runtime.empty() && runtime.size() <= 64 &&
                      runtime.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789._-") ==
                          std::string::npos;
    if (!good) {
      reader.Fail("runtimes", absl::StrCat("holds ", Quoted(runtime),
                                           "; names consist of a-z, 0-9, '.', '_', '-'"));
    } else if (!seen.insert(runtime).second) {
      reader.Fail("runtimes", absl::StrCat("names ", Quoted(runtime), " twice"));
    }
  }
  if (runtimes.size() > kMaxRuntimes) {
    reader.Fail("runtimes", absl::StrCat("names more than ", kMaxRuntimes));
  }
}

// Variables that the policy or one of its libraries reads, with values that fit into any process'
// environment.
std::map<std::string, std::string> ReadEnvironment(ConfigReader& reader) {
  std::map<std::string, std::string> variables = reader.StringsByName("env");
  size_t bytes = 0;
  for (const auto& [name, value] : variables) {
    if (!MayBeSet(name)) {
      reader.Fail("env", absl::StrCat("sets ", Quoted(name), ", which is not allowed; it may set ",
                                      Known(), " (POLICY_* for your own names)"));
    }
    if (value.size() > kMaxValueBytes || value.find('\0') != std::string::npos) {
      reader.Fail(
          "env", absl::StrCat("has a value of ", Quoted(name), " with a zero byte or of more than ",
                              kMaxValueBytes, " bytes"));
    }
    bytes += name.size() + value.size() + 2;
  }
  if (variables.size() > kMaxVariables || bytes > kMaxEnvironmentBytes) {
    reader.Fail("env", absl::StrCat("must have at most ", kMaxVariables, " variables and ",
                                    kMaxEnvironmentBytes, " bytes together"));
  }
  return variables;
}

// What an adapter runs in is one of the submission's runtimes, named or not.
void ReadAdapter(ConfigReader& reader, PolicyManifest& manifest) {
  manifest.adapter = reader.Choice("adapter", AdapterNames());
  const Adapter* adapter = FindAdapter(manifest.adapter);
  if (adapter != nullptr &&
      std::ranges::find(manifest.runtimes, adapter->runtime) == manifest.runtimes.end()) {
    manifest.runtimes.emplace_back(adapter->runtime);
  }
}

absl::Status BadImageFile(const std::string& file, absl::string_view rule) {
  return absl::InvalidArgumentError(
      absl::StrCat("policy.json: \"image\" is ", Quoted(file), ", which ", rule));
}

// The image's archive lies beside policy.json, and nothing else does: the image has all files.
absl::Status CheckImageFile(int root, const std::string& file) {
  if (file.find('/') != std::string::npos || file == "policy.json" || file.starts_with('.')) {
    return BadImageFile(file, "is not the name of a file in the folder of policy.json");
  }
  const Fd fd = OpenBeneath(root, file, O_PATH);
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return BadImageFile(file, "does not exist; save the image into the submission's folder");
  }
  const auto names = NamesIn(root);
  if (!names.has_value()) return HostError("can't list the submission");
  for (const std::string& name : *names) {
    if (name == file || name == "policy.json") continue;
    return absl::InvalidArgumentError(
        absl::StrCat("beside policy.json and its image there is ", Quoted(name),
                     ", which the image can't see; put it into the image, or remove it"));
  }
  return absl::OkStatus();
}

// `image`: where to put the name of the image's archive; null: the image was unpacked, and "image" is
// what its program needs of it.
absl::StatusOr<PolicyManifest> ParseKeys(const nlohmann::json& json, std::string* image) {
  ConfigReader reader(json, "policy.json");
  PolicyManifest manifest;
  manifest.name = reader.String("name");
  if (image == nullptr && reader.Has("image")) {
    ASSIGN_OR_RETURN(manifest.image,
                     PolicyImageFromJson(reader.Object("image"), "policy.json: image"));
  } else if (reader.Has("image")) {
    *image = reader.String("image");
    if (image->empty()) reader.Fail("image", "must be the name of an image's archive");
  }
  const bool own_command = image == nullptr || image->empty() || reader.Has("command");
  if (own_command) manifest.command = reader.Strings("command");
  if (reader.Has("runtimes")) manifest.runtimes = reader.Strings("runtimes");
  if (reader.Has("env")) manifest.environment = ReadEnvironment(reader);
  if (reader.Has("adapter")) ReadAdapter(reader, manifest);
  if (reader.Has("extra_observations")) {
    manifest.extra_observations = reader.Boolean("extra_observations");
  }
  CheckName(reader, manifest.name);
  if (own_command) CheckCommand(reader, manifest.command);
  CheckRuntimes(reader, manifest.runtimes);
  RETURN_IF_ERROR(reader.Finish());
  return manifest;
}

}  // namespace

absl::StatusOr<PolicyManifest> ParseManifest(const nlohmann::json& json) {
  return ParseKeys(json, /*image=*/nullptr);
}

absl::StatusOr<SubmittedManifest> ReadSubmittedManifest(int folder, const std::string& name) {
  ASSIGN_OR_RETURN(const std::string text, ReadManifestText(folder));
  ASSIGN_OR_RETURN(nlohmann::json json, ParseJson(text, "policy.json"));
  if (!name.empty() && json.is_object()) json["name"] = name;
  SubmittedManifest submitted;
  ASSIGN_OR_RETURN(submitted.manifest, ParseKeys(json, &submitted.image_file));
  submitted.json = std::move(json);
  std::vector<std::string>& command = submitted.manifest.command;
  if (!submitted.image_file.empty()) {
    RETURN_IF_ERROR(CheckImageFile(folder, submitted.image_file));
    return submitted;
  }
  NameOwnProgram(folder, command[0]);
  if (command[0].find('/') != std::string::npos && command[0][0] != '/') {
    RETURN_IF_ERROR(CheckProgram(folder, command[0]));
  }
  return submitted;
}

}  // namespace myograde::server
