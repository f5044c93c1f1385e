#include "server/artefact/image_archive.h"

#include <algorithm>
#include <climits>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxImageVariables = 256;
constexpr size_t kMaxImageEnvironmentBytes = 32 << 10;
constexpr size_t kMaxLayers = 128;  // as engines have

absl::Status BadConfig(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("the image's config ", what));
}

// An array of texts, or null.
absl::StatusOr<std::vector<std::string>> Texts(const Json& json, std::string_view key) {
  std::vector<std::string> texts;
  const Json& list = At(json, key);
  bool good = list.is_array() || list.is_null();
  for (const Json& text : list) {
    good = good && text.is_string() &&
           text.get_ref<const std::string&>().find('\0') == std::string::npos;
    if (good) texts.push_back(text);
  }
  if (good) return texts;
  return BadConfig(absl::StrCat("has a \"", std::string(key), "\" that is not a list of strings"));
}

absl::Status ReadVariables(const Json& config, PolicyImage& image) {
  ASSIGN_OR_RETURN(const std::vector<std::string> variables, Texts(config, "Env"));
  size_t bytes = 0;
  for (const std::string& variable : variables) {
    const size_t equals = variable.find('=');
    if (equals == 0 || equals == std::string::npos) continue;
    const std::string name = variable.substr(0, equals);
    // The grader's own.
    if (name.starts_with("MYOGRADE_")) continue;
    image.environment[name] = variable.substr(equals + 1);
    bytes += variable.size() + 1;
  }
  if (image.environment.size() <= kMaxImageVariables && bytes <= kMaxImageEnvironmentBytes) {
    return absl::OkStatus();
  }
  return BadConfig(absl::StrCat("sets more than ", kMaxImageVariables, " variables or ",
                                kMaxImageEnvironmentBytes, " bytes of them"));
}

// The fields of the line of a passwd or group file whose field `key` is `value`.
std::vector<std::string> LineWith(std::string_view text, size_t key, std::string_view value) {
  for (const absl::string_view line : absl::StrSplit(absl::string_view(text.data(), text.size()), '\n')) {
    std::vector<std::string> fields = absl::StrSplit(line, ':');
    if (fields.size() > std::max<size_t>(key, 2) && fields[key] == value) return fields;
  }
  return {};
}

// A user or group number; nullopt: none.
std::optional<int64_t> ParseId(std::string_view text) {
  int64_t id = 0;
  const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string_view::npos;
  if (!digits || !absl::SimpleAtoi(absl::string_view(text.data(), text.size()), &id)) {
    return std::nullopt;
  }
  return id;
}

absl::Status UnknownUser(std::string_view kind, std::string_view name, std::string_view file) {
  return absl::InvalidArgumentError(
      absl::StrCat("the image's ", std::string(kind), " ", Quoted(name), " is not in its ",
                   std::string(file), ", and is not a number from 0 to ", INT32_MAX,
                   "; add it, or build the image with another USER"));
}

}  // namespace

std::string TagOfDockerManifest(const Json& manifest) {
  if (!manifest.is_array() || manifest.empty()) return "";
  const Json& tags = At(manifest[0], "RepoTags");
  return tags.is_array() && !tags.empty() && tags[0].is_string() ? tags[0].get<std::string>() : "";
}

std::string TagOfIndex(const Json& index) {
  for (const Json& entry : At(index, "manifests")) {
    const Json& notes = At(entry, "annotations");
    for (const char* key : {"io.containerd.image.name", "org.opencontainers.image.ref.name"}) {
      if (std::string tag = TextAt(notes, key); !tag.empty()) return tag;
    }
  }
  return "";
}

absl::StatusOr<std::string> ParseDigest(std::string_view text, std::string_view where) {
  constexpr std::string_view kPrefix = "sha256:";
  const std::string_view hex = text.substr(std::min(text.size(), kPrefix.size()));
  if (text.starts_with(kPrefix) && IsSha256Hex(hex)) return std::string(hex);
  return absl::InvalidArgumentError(absl::StrCat("the image's ", std::string(where),
                                                 " has the digest ", Quoted(text),
                                                 "; only SHA-256 is supported"));
}

absl::StatusOr<ImageConfig> ReadImageConfig(const Json& json) {
  if (PlatformName(json) != "linux/amd64") {
    return absl::InvalidArgumentError(absl::StrCat(
        "the image is for ", Quoted(PlatformName(json)),
        ", but the server runs linux/amd64; build it with --platform linux/amd64"));
  }
  ImageConfig read;
  const Json& config = At(json, "config");
  for (const char* key : {"Entrypoint", "Cmd"}) {
    ASSIGN_OR_RETURN(const std::vector<std::string> words, Texts(config, key));
    read.command.insert(read.command.end(), words.begin(), words.end());
  }
  RETURN_IF_ERROR(ReadVariables(config, read.image));
  read.user = TextAt(config, "User");
  if (const std::string folder = TextAt(config, "WorkingDir"); !folder.empty()) {
    read.image.working_dir = folder;
  }
  if (!read.image.working_dir.starts_with('/')) {
    return BadConfig("has a working folder that is not an absolute path");
  }
  ASSIGN_OR_RETURN(std::vector<std::string> ids, Texts(At(json, "rootfs"), "diff_ids"));
  if (ids.empty() || ids.size() > kMaxLayers) {
    return BadConfig(absl::StrCat("lists ", ids.size(), " layers; 1 to ", kMaxLayers,
                                  " are possible"));
  }
  for (const std::string& id : ids) {
    ASSIGN_OR_RETURN(std::string hex, ParseDigest(id, "config"));
    read.diff_ids.push_back(std::move(hex));
  }
  return read;
}

absl::Status FindUser(std::string_view user, std::string_view passwd, std::string_view group,
                      PolicyImage& image) {
  const size_t colon = user.find(':');
  const std::string_view name = user.substr(0, colon);
  const std::string_view group_name = colon == std::string_view::npos ? "" : user.substr(colon + 1);
  std::vector<std::string> line = LineWith(passwd, 0, name.empty() ? "root" : name);
  if (line.empty()) line = LineWith(passwd, 2, name.empty() ? "0" : name);
  const bool root = name.empty() || name == "root" || name == "0";
  std::string home = line.size() > 5 ? line[5] : "";
  if (home.empty()) home = root ? "/root" : "/";
  if (home.size() >= PATH_MAX) {
    return absl::InvalidArgumentError(
        absl::StrCat("the home folder of the image's user in its /etc/passwd is a path of ", home.size(),
                     " bytes; at most ", PATH_MAX - 1, " are possible"));
  }
  image.environment.emplace("HOME", std::move(home));
  if (name.empty()) return absl::OkStatus();
  const std::optional<int64_t> uid = ParseId(line.empty() ? name : std::string_view(line[2]));
  if (!uid.has_value() || *uid > INT32_MAX) return UnknownUser("user", name, "/etc/passwd");
  std::optional<int64_t> gid = line.size() > 3 ? ParseId(line[3]) : 0;
  if (!group_name.empty()) {
    const std::vector<std::string> found = LineWith(group, 0, group_name);
    gid = ParseId(found.empty() ? group_name : std::string_view(found[2]));
  }
  if (!gid.has_value() || *gid > INT32_MAX) return UnknownUser("group", group_name, "/etc/group");
  // No policy is root.
  if (*uid > 0) image.uid = *uid;
  if (*gid > 0) image.gid = *gid;
  return absl::OkStatus();
}

}  // namespace myograde::server
