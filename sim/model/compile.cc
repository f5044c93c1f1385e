#include "sim/model/compile.h"

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <stdlib.h>

#include <filesystem>
#include <span>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "protocol/base/file.h"
#include "protocol/base/set_up.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::sim {
namespace {

namespace fs = std::filesystem;

// Raise it with any change of a patch that ModelKey does not see by itself.
constexpr int kPatchRevision = 2;

struct Pin {
  std::string_view digest;
  std::string_view path;  // relative to the package
};

std::vector<Pin> Pins(std::string_view text) {
  constexpr size_t kDigits = 64;
  std::vector<Pin> pins;
  while (!text.empty()) {
    const size_t end = text.find('\n');
    const std::string_view line = text.substr(0, end);
    if (line.size() > kDigits + 2) pins.push_back({line.substr(0, kDigits), line.substr(66)});
    text = end == std::string_view::npos ? "" : text.substr(end + 1);
  }
  return pins;
}

absl::StatusOr<std::string> ReadPinned(const Pin& pin, const std::string& package_dir) {
  const std::string path = absl::StrCat(package_dir, "/", std::string(pin.path));
  auto text = ReadFile(path);
  if (!text.ok()) {
    return absl::NotFoundError(absl::StrCat("model file ", path,
                                            " is missing or can't be read: ", SetUpAdvice()));
  }
  if (Sha256Hex(*text) != pin.digest) {
    return absl::DataLossError(
        absl::StrCat("model file ", path, " was altered (its SHA-256 is not the pinned one): ",
                     "delete the folder ", package_dir, " and ", SetUpAdvice()));
  }
  return text;
}

// Pictures don't move anything and are nine tenths of the compiled arm model.
void DropTextures(std::string& text) {
  for (size_t at; (at = text.find("<texture ")) != std::string::npos;) {
    text.erase(at, text.find('>', at) + 1 - at);
  }
  constexpr std::string_view kEnd = "</texture>";
  for (size_t at; (at = text.find(kEnd)) != std::string::npos;) text.erase(at, kEnd.size());
  for (const char quote : {'"', '\''}) {
    const std::string attribute = absl::StrCat(" texture=", std::string(1, quote));
    for (size_t at; (at = text.find(attribute)) != std::string::npos;) {
      text.erase(at, text.find(quote, at + attribute.size()) + 1 - at);
    }
  }
}

// A folder that is gone with its owner.
class ScratchFolder {
 public:
  static absl::StatusOr<ScratchFolder> Make() {
    std::error_code error;
    const fs::path parent = fs::temp_directory_path(error);
    std::string path = (error ? fs::path("/tmp") : parent) / "myograde-model-XXXXXX";
    if (mkdtemp(path.data()) == nullptr) {
      return absl::UnavailableError(
          absl::StrCat("can't create a folder ", path, " to compile models in; set TMPDIR"));
    }
    return ScratchFolder(path);
  }
  ScratchFolder(ScratchFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  ScratchFolder& operator=(ScratchFolder&&) = delete;
  ~ScratchFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }

 private:
  explicit ScratchFolder(fs::path path) : path_(std::move(path)) {}
  fs::path path_;
};

bool IsXml(std::string_view path) { return path.ends_with(".xml"); }
bool IsByteArray(std::string_view path) { return path.ends_with(".npy"); }

// A pinned array of bytes in NumPy's format as a custom text of the model, in hexadecimal digits
// under its file's name: an episode can't read files.
std::string AsText(std::string_view path, std::string_view file) {
  constexpr size_t kHeaderSize = 8, kHeader = 10;  // offsets: its size in two bytes, its beginning
  const size_t header = static_cast<uint8_t>(file[kHeaderSize]) +
                        256 * static_cast<size_t>(static_cast<uint8_t>(file[kHeaderSize + 1]));
  return absl::StrCat("<custom><text name=\"", fs::path(path).stem().string(), "\" data=\"",
                      absl::BytesToHexString(std::string(file.substr(kHeader + header))),
                      "\"/></custom>\n");
}

// Fills `scratch` with patched XML files and links to everything else.
absl::Status FillScratch(const ModelSource& source, const std::string& package_dir,
                         const fs::path& scratch) {
  std::string main;
  std::string assets;
  std::string texts;
  for (const Pin& pin : Pins(source.pins)) {
    ASSIGN_OR_RETURN(auto text, ReadPinned(pin, package_dir));
    const fs::path to = scratch / pin.path;
    std::error_code error;
    fs::create_directories(to.parent_path(), error);
    if (IsXml(pin.path)) DropTextures(text);
    if (pin.path == source.main_file) {
      main = std::move(text);
    } else if (pin.path == source.actuator_file) {
      assets = std::move(text);
    } else if (IsByteArray(pin.path)) {
      texts += AsText(pin.path, text);
    } else if (IsXml(pin.path)) {
      if (auto status = WriteFile(to, text); !status.ok()) return status;
    } else {
      fs::create_symlink(fs::absolute(package_dir) / pin.path, to, error);
      if (error) return absl::UnavailableError(absl::StrCat("can't create ", to.string()));
    }
  }
  if (!texts.empty()) RETURN_IF_ERROR(InsertBefore(main, "<worldbody>", texts));
  RETURN_IF_ERROR(source.patch == nullptr ? absl::OkStatus() : source.patch(main, assets));
  if (auto status = WriteFile(scratch / source.main_file, main); !status.ok()) return status;
  return WriteFile(scratch / source.actuator_file, assets);
}

absl::Status SetInertials(mjModel* model, std::span<const Inertial> inertials) {
  for (const Inertial& inertial : inertials) {
    const int body = mj_name2id(model, mjOBJ_BODY, inertial.body);
    if (body < 0) {
      return absl::InternalError(absl::StrCat("the model has no body ", inertial.body));
    }
    model->body_mass[body] = inertial.mass;
    mju_copy3(model->body_ipos + 3 * body, inertial.position.data());
    mju_copy4(model->body_iquat + 4 * body, inertial.rotation.data());
    mju_copy3(model->body_inertia + 3 * body, inertial.inertia.data());
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::string> Cut(std::string& text, const std::string& begin,
                                const std::string& end) {
  const size_t from = text.find(begin);
  const size_t to = from == std::string::npos ? from : text.find(end, from);
  if (to == std::string::npos || text.find(begin, to) != std::string::npos) {
    return absl::InternalError(
        absl::StrFormat("model patch: expected exactly one %s ... %s", begin, end));
  }
  std::string piece = text.substr(from, to + end.size() - from);
  text.erase(from, piece.size());
  return piece;
}

absl::Status InsertBefore(std::string& text, const std::string& marker, const std::string& piece) {
  const size_t at = text.rfind(marker);
  if (at == std::string::npos) {
    return absl::InternalError(absl::StrFormat("model patch: no %s to insert before", marker));
  }
  text.insert(at, piece);
  return absl::OkStatus();
}

absl::StatusOr<ModelPtr> CompileFromSources(const ModelSource& source,
                                            const std::string& package_dir) {
  ASSIGN_OR_RETURN(auto scratch, ScratchFolder::Make());
  if (auto status = FillScratch(source, package_dir, scratch.path()); !status.ok()) return status;

  char error[1000] = "";
  ModelPtr model(mj_loadXML((scratch.path() / source.main_file).c_str(), nullptr, error,
                            sizeof(error)));
  if (model == nullptr) {
    return absl::InternalError(absl::StrCat("MuJoCo can't compile ", source.main_file, ": ",
                                            error));
  }
  if (auto status = SetInertials(model.get(), source.inertials); !status.ok()) return status;
  model->njmax = source.buffers.constraints;
  model->nconmax = source.buffers.contacts;
  model->nstack = source.buffers.stack;
  for (int i = 0; i < model->nu; ++i) {
    // The gain of a muscle is the callback's: see InstallCallbacks.
    if (model->actuator_gaintype[i] == mjGAIN_MUSCLE) model->actuator_gaintype[i] = mjGAIN_USER;
  }
  DataPtr data(mj_makeData(model.get()));
  if (data == nullptr) return absl::ResourceExhaustedError("no memory for MuJoCo's data");
  mj_setConst(model.get(), data.get());  // weights that follow from the new inertials
  return model;
}

std::string ModelKey(const ModelSource& source) {
  Sha256 hash;
  hash.Update(source.pins);
  hash.Update(absl::StrFormat("patch %d mujoco %d %s buffers %d %d %d\n", kPatchRevision,
                              mj_version(), MYOGRADE_MUJOCO_BUILD, source.buffers.constraints,
                              source.buffers.contacts, source.buffers.stack));
  for (const Inertial& inertial : source.inertials) {
    hash.Update(absl::StrFormat("%s %a", inertial.body, inertial.mass));
    for (double x : inertial.position) hash.Update(absl::StrFormat(" %a", x));
    for (double x : inertial.rotation) hash.Update(absl::StrFormat(" %a", x));
    for (double x : inertial.inertia) hash.Update(absl::StrFormat(" %a", x));
  }
  return hash.FinishHex();
}

}  // namespace myograde::sim
