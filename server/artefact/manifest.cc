#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <filesystem>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/config_reader.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/adapters.h"
#include "server/artefact/artefact.h"
#include "server/artefact/beneath.h"
#include "server/artefact/environment.h"
#include "server/artefact/listing.h"
#include "server/artefact/submitted_manifest.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxManifestBytes = 64 << 10;
constexpr size_t kMaxNameBytes = 64;
constexpr size_t kMaxArguments = 256;
constexpr size_t kMaxArgumentBytes = 4096;
constexpr size_t kMaxRuntimes = 8;
constexpr int kMaxLinkHops = 16;

// "policy.json is missing", with the folder that contains it if somebody packed a folder instead of
// its content.
absl::Status MissingManifest(int root) {
  std::string hint;
  if (OpenBeneath(root, ".dockerenv", O_PATH).valid() ||
      (OpenBeneath(root, "usr/bin", O_PATH).valid() && OpenBeneath(root, "etc", O_PATH).valid())) {
    hint = "; it looks like the files of a container without the image's configuration, as \"docker "
           "export\" writes them: save the image, with \"docker save\" or \"podman save\"";
  }
  if (OpenBeneath(root, "index.json", O_PATH).valid() && OpenBeneath(root, "blobs", O_PATH).valid()) {
    hint = "; it looks like a container image in OCI's layout that is no tar, or lacks the file oci-layout: "
           "write it with podman save, docker save or buildah push IMAGE oci-archive:FILE.tar";
  }
  const int copy = ::openat(root, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (DIR* names = copy >= 0 ? ::fdopendir(copy) : nullptr; names != nullptr) {
    while (const dirent* name = ::readdir(names)) {
      const std::string inner = std::string(name->d_name) + "/policy.json";
      if (inner.starts_with('.')) continue;
      const std::string folder(name->d_name);
      if (OpenBeneath(root, inner, O_PATH).valid()) {
        hint = absl::StrCat("; it is at ", Quoted(inner), ", so submit that folder itself");
      } else if (OpenBeneath(root, folder + "/index.json", O_PATH).valid() ||
                 OpenBeneath(root, folder + "/manifest.json", O_PATH).valid()) {
        hint = absl::StrCat("; the folder ", Quoted(folder), " looks like a container image: pack what is in "
                            "it and not the folder, with \"tar -C ", folder, " -cf image.tar .\"");
      }
    }
    ::closedir(names);
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
    return absl::InvalidArgumentError("policy.json must be a file that can be read, not a link");
  }
  std::string text(kMaxManifestBytes + 1, '\0');
  size_t size = 0;
  while (size < text.size()) {
    const ssize_t got = ::read(fd.get(), text.data() + size, text.size() - size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return HostError("can't read policy.json");
    if (got == 0) break;
    size += static_cast<size_t>(got);
  }
  if (size > kMaxManifestBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("policy.json is larger than ", kMaxManifestBytes, " bytes"));
  }
  text.resize(size);
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff") ||
      text.find('\0') != std::string::npos) {
    return absl::InvalidArgumentError(
        "policy.json is not in UTF-8, perhaps in UTF-16, as some shells and editors of Windows write files; "
        "save it as UTF-8 (in PowerShell: Set-Content -Encoding utf8)");
  }
  return text;
}

absl::Status BadCommand(std::string_view command, std::string_view rule) {
  return absl::InvalidArgumentError(absl::StrCat("policy.json: \"command\" starts with ",
                                                 Quoted(command), ", which ",
                                                 absl::string_view(rule.data(), rule.size())));
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
      return BadCommand(command, errno == ELOOP ? "goes through a symbolic link to a folder; "
                                                  "name the program's real place"
                                                : "is not there; give a file of the submission, "
                                                  "or a program of the sandbox as python3");
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
    std::string target(PATH_MAX, '\0');
    const ssize_t size = ::readlinkat(fd.get(), "", target.data(), target.size());
    if (size <= 0) return BadCommand(command, "is a symbolic link that can't be read");
    target.resize(static_cast<size_t>(size));
    if (target.starts_with('/')) return absl::OkStatus();
    path = (std::filesystem::path(path).parent_path() / target).lexically_normal().string();
  }
  return BadCommand(command, "is a loop of symbolic links");
}

void CheckName(ConfigReader& reader, const std::string& name) {
  if (const std::string harm = FirstHarm(name); !harm.empty()) {
    reader.Fail("name", absl::StrCat("has ", harm, ", which is not seen, or changes how others are "
                                     "seen; leave it out"));
  } else if (!IsPlainText(name, kMaxNameBytes)) {
    reader.Fail("name", absl::StrCat("must have 1 to ", kMaxNameBytes,
                                     " bytes without a space at its "
                                     "ends"));
  }
}

void CheckCommand(ConfigReader& reader, const std::vector<std::string>& command) {
  if (command.empty() || command.size() > kMaxArguments) {
    reader.Fail("command", absl::StrCat("must hold the program and its arguments: 1 to ",
                                        kMaxArguments, " strings"));
    return;
  }
  for (const std::string& argument : command) {
    if (argument.size() > kMaxArgumentBytes || argument.find('\0') != std::string::npos) {
      reader.Fail("command", absl::StrCat("holds a string with a zero byte or of more than ",
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
                                           "; names are of a-z, 0-9, '.', '_', '-'"));
    } else if (!seen.insert(runtime).second) {
      reader.Fail("runtimes", absl::StrCat("names ", Quoted(runtime), " twice"));
    }
  }
  if (runtimes.size() > kMaxRuntimes) {
    reader.Fail("runtimes", absl::StrCat("names more than ", kMaxRuntimes));
  }
}

// What an adapter runs in is one of the submission's runtimes, named or not.
void ReadAdapter(ConfigReader& reader, ArtefactManifest& manifest) {
  manifest.adapter = reader.Choice("adapter", AdapterNames());
  const Adapter* adapter = FindAdapter(manifest.adapter);
  if (adapter == nullptr) return;
  const std::string runtime(adapter->runtime);
  if (std::ranges::find(manifest.runtimes, runtime) == manifest.runtimes.end()) {
    manifest.runtimes.push_back(runtime);
  }
}

absl::Status BadImageFile(const std::string& file, std::string_view rule) {
  return absl::InvalidArgumentError(absl::StrCat("policy.json: \"image\" is ", Quoted(file), ", which ",
                                                 absl::string_view(rule.data(), rule.size())));
}

// The image's archive lies beside policy.json, and nothing else does: the image has all files.
absl::Status CheckImageFile(int root, const std::string& file) {
  if (file.find('/') != std::string::npos || file == "policy.json" || file.starts_with('.')) {
    return BadImageFile(file, "is not the name of a file beside policy.json");
  }
  const Fd fd = OpenBeneath(root, file, O_PATH);
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode)) {
    return BadImageFile(file, "is not there; save the image into the submission's folder");
  }
  const int copy = ::openat(root, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  DIR* names = copy >= 0 ? ::fdopendir(copy) : nullptr;
  if (names == nullptr) return HostError("can't list the submission");
  std::string further;
  while (const dirent* name = ::readdir(names)) {
    const std::string entry = name->d_name;
    if (entry != "." && entry != ".." && entry != file && entry != "policy.json") further = entry;
  }
  ::closedir(names);
  if (further.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "beside policy.json and its image there is ", Quoted(further),
      ", which the image would not see; put it into the image, or remove it"));
}

// `image`: where to put the name of the image's archive; null: there must be none.
absl::StatusOr<ArtefactManifest> ParseKeys(const nlohmann::json& json, std::string* image) {
  ConfigReader reader(json, "policy.json");
  ArtefactManifest manifest;
  manifest.name = reader.String("name");
  if (image != nullptr && reader.Has("image")) {
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

absl::StatusOr<ArtefactManifest> ReadManifest(const std::string& folder) {
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!root.valid()) return HostError(absl::StrCat("can't open the folder ", folder));
  return ReadManifest(root.get());
}

absl::StatusOr<ArtefactManifest> ReadManifest(int folder) {
  ASSIGN_OR_RETURN(SubmittedManifest submitted, ReadSubmittedManifest(folder));
  return std::move(submitted.manifest);
}

absl::StatusOr<ArtefactManifest> ParseManifest(const nlohmann::json& json) {
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
