// Container images: layers of entries with names that meet each other, and any JSON as the config.
// Digests are right, so that the layers are applied.
//
// The input: for each entry a byte for its type, one for its name and one for its target; type 7
// begins a layer, type 8 ends the list. The rest is the config's "config" object.
#include <sys/stat.h>

#include <array>

#include <nlohmann/json.hpp>

#include "server/artefact/artefact.h"
#include "server/sandbox/program.h"
#include "tests/fuzz/fuzz.h"
#include "tests/server/artefact/image_builder.h"

using namespace myograde;
using fuzz::Require;

namespace {

namespace fs = std::filesystem;

constexpr server::ArtefactLimits kImageLimits = {
    .bytes = 4096, .files = 40, .depth = 6, .name_bytes = 64};
constexpr std::array kNames = {
    "a",        "b",        "a/b",           "a/b/c",    "a/b/c/d/e/f", "l",          "l/x",
    ".wh.a",    "a/.wh.b",  ".wh..wh..opq",  "a/.wh..wh..opq",          ".wh.l",      ".wh.",
    "../x",     "etc",      "etc/passwd",    "etc/group", "etc/hosts",  "etc/ld.so.preload",
    "dev/null", "tmp/x",    "proc",          "myograde", "/abs",        "run",        "."};
constexpr std::array kTargets = {"a",     "l",          "/",     "..",     "../../../../etc", "/a/b",
                                 "/proc", "/etc/passwd", "a/b/c", "/dev/x", "",               "b"};

// What is on the disk, without following anything.
struct Disk {
  int64_t entries = 0;
  int64_t bytes = 0;
};

Disk LookAt(const fs::path& folder) {
  Disk disk;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    struct stat info = {};
    Require(::lstat(entry.path().c_str(), &info) == 0, "what is listed is there");
    ++disk.entries;
    if (S_ISREG(info.st_mode)) disk.bytes += info.st_size;
    Require(S_ISREG(info.st_mode) || S_ISDIR(info.st_mode) || S_ISLNK(info.st_mode),
            "only files, folders and links");
    Require(S_ISLNK(info.st_mode) || (info.st_mode & 07777) == 0755 ||
                (S_ISREG(info.st_mode) && (info.st_mode & 07777) == 0644),
            "modes are plain");
  }
  return disk;
}

std::vector<std::string> LayersOf(fuzz::Input& input) {
  std::vector<std::string> layers = {""};
  while (!input.empty() && layers.size() < 8) {
    const uint8_t type = input.Byte();
    if (type == '7') {
      layers.emplace_back();
      continue;
    }
    if (type == '8') break;
    const char* name = kNames[input.Byte() % kNames.size()];
    const char* target = kTargets[input.Byte() % kTargets.size()];
    const bool file = type == '0';
    layers.back() += server::TarEntry(static_cast<char>(type), name,
                                      file ? "root:x:0:0::/:\napp:x:7:8::/:\n" : "",
                                      file ? "" : target, 04755);
  }
  for (std::string& layer : layers) layer = server::Layer(layer);
  return layers;
}

}  // namespace

MYOGRADE_FUZZ_TARGET(image)(const uint8_t* data, size_t size) {
  static const fuzz::Folder folder;
  fuzz::Input input(data, size);
  const std::vector<std::string> layers = LayersOf(input);
  nlohmann::json config = nlohmann::json::parse(input.Text(size), nullptr, false);
  if (config.is_discarded()) config = {{"Entrypoint", {"/run"}}, {"User", "app"}};
  nlohmann::json about = server::ImageConfigOf(layers, config);
  if (config.contains("architecture")) about.update(config);
  const std::string out = folder / "out";
  std::string archive;
  try {
    archive = server::DockerImage(layers, about);
  } catch (const nlohmann::json::exception&) {
    return 0;  // text that JSON can't hold
  }
  fuzz::WriteFile(folder / "archive", archive);
  const auto artefact = server::UnpackArtefact(folder / "archive", out, kImageLimits);
  int beside = 0;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    beside += entry.path().filename() != "out" ? 1 : 0;
  }
  Require(beside == 1, "nothing is written outside");
  if (!artefact.ok()) {
    Require(absl::IsInvalidArgument(artefact.status()), "a bad image is the participant's");
    Require(artefact.status().message().find('\n') == absl::string_view::npos,
            "a refusal is one line");
    Require(!fs::exists(fs::symlink_status(out)), "nothing is left");
    return 0;
  }
  const Disk disk = LookAt(out);
  Require(artefact->files == disk.entries && artefact->bytes == disk.bytes,
          "the list is what is on the disk");
  const PolicyImage& image = artefact->manifest.image.value();
  Require(image.uid > 0 && image.gid > 0, "no policy is root");
  for (const auto& [name, value] : image.environment) {
    Require(!name.starts_with("MYOGRADE_"), "the grader's variables are its own");
    if (name == "HOME") Require(value.starts_with('/'), "a home folder is a path");
  }
  for (const char* gone : {"proc", "dev", "tmp", "myograde", "etc/ld.so.preload"}) {
    Require(!fs::exists(fs::symlink_status(out + "/image/" + gone)), "what is replaced is left out");
  }
  Require(!fs::is_symlink(out + "/image/etc"), "/etc is a folder");
  const absl::Status starts = server::CheckProgram(artefact->manifest, out, {});
  Require(starts.ok() || absl::IsInvalidArgument(starts), "a bad command is the participant's");
  fs::remove_all(out);
  return 0;
}
