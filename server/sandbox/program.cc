#include "server/sandbox/program.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <deque>
#include <filesystem>
#include <optional>
#include <string_view>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/sandbox/policy_sandbox.h"

namespace myograde::server {
namespace {

constexpr char kPolicy[] = "/policy";
constexpr int kMaxLinks = 40;        // as in the kernel
constexpr int kMaxInterpreters = 4;  // scripts interpreted by scripts; as in the kernel
constexpr size_t kMaxVenvConfig = 64 << 10;

bool IsAtOrBelow(const std::string& path, const std::string& folder) {
  return path == folder || path.starts_with(folder + "/");
}

// A file of the sandbox, with all links in its path resolved.
struct Found {
  std::string path;
  mode_t mode = 0;
};

// The sandbox' file system as far as programs need it, seen from outside.
class SandboxView {
 public:
  // `image`: `artefact` is the root of an image instead of what is shown at /policy.
  SandboxView(int artefact, const std::vector<std::string>& runtimes, bool image)
      : artefact_(artefact), image_(image) {
    if (!image) {
      host_ = SystemPlaces();
      links_ = SystemLinks();
    }
    host_.insert(host_.end(), runtimes.begin(), runtimes.end());
  }

  // Resolves an absolute path; if it does not exist, `missing` is where resolution failed.
  std::optional<Found> Find(const std::string& path, std::string& missing) const {
    std::deque<std::string> names;
    for (const absl::string_view name : absl::StrSplit(path, '/')) names.emplace_back(name);
    Found at = {"", S_IFDIR};
    int links = 0;
    while (!names.empty()) {
      const std::string name = names.front();
      names.pop_front();
      if (name.empty() || name == ".") continue;
      if (name == "..") {
        at.path.erase(std::min(at.path.rfind('/'), at.path.size()));
        at.mode = S_IFDIR;
        continue;
      }
      missing = at.path + "/" + name;
      if (!S_ISDIR(at.mode)) return std::nullopt;
      std::string target;
      const mode_t mode = LookAt(missing, target);
      if (mode == 0) return std::nullopt;
      if (!S_ISLNK(mode)) {
        at = {missing, mode};
        continue;
      }
      if (++links > kMaxLinks) return std::nullopt;
      if (target.starts_with('/')) at = {"", S_IFDIR};
      const std::vector<std::string> more = absl::StrSplit(target, '/');
      names.insert(names.begin(), more.begin(), more.end());
    }
    return at;
  }

  // Opens a file that Find returned, for reading.
  Fd Open(const std::string& path) const {
    if (const std::string inside = InArtefact(path); !inside.empty()) {
      return OpenBeneath(artefact_, inside, O_RDONLY | O_NONBLOCK);
    }
    return Fd(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC));
  }

 private:
  // The type and mode of a path whose folder has no link in it; 0 if it does not exist. `target`: a
  // link's target.
  mode_t LookAt(const std::string& path, std::string& target) const {
    for (const std::string& link : links_) {
      if (path == "/" + link) return target = "usr/" + link, S_IFLNK;
    }
    if (!image_ && path == kPolicy) return S_IFDIR | 0755;
    if (const std::string inside = InArtefact(path); !inside.empty()) {
      return ModeOf(OpenBeneath(artefact_, inside, O_PATH), target);
    }
    for (const std::string& place : host_) {
      if (IsAtOrBelow(path, place)) {
        return ModeOf(Fd(::open(path.c_str(), O_PATH | O_NOFOLLOW | O_CLOEXEC)), target);
      }
      if (IsAtOrBelow(place, path)) return S_IFDIR | 0755;
    }
    return 0;
  }

  // Where the artefact has it, "" if it does not: runtimes and the sandbox' own parts replace what
  // an image has.
  std::string InArtefact(const std::string& path) const {
    if (!image_) return path.starts_with("/policy/") ? path.substr(sizeof(kPolicy)) : "";
    for (const std::string& place : host_) {
      if (IsAtOrBelow(path, place) || IsAtOrBelow(place, path)) return "";
    }
    const std::string_view top = std::string_view(path).substr(1, path.find('/', 1) - 1);
    return IsReplacedByTheSandbox(top) ? "" : path.substr(1);
  }

  static mode_t ModeOf(const Fd& fd, std::string& target) {
    struct stat info = {};
    if (!fd.valid() || ::fstat(fd.get(), &info) != 0) return 0;
    if (!S_ISLNK(info.st_mode)) return info.st_mode;
    target = TargetOf(fd.get());
    return target.empty() ? 0 : info.st_mode;
  }

  const int artefact_;
  const bool image_;
  std::vector<std::string> host_;
  std::vector<std::string> links_;
};

class ProgramCheck {
 public:
  ProgramCheck(const PolicyManifest& manifest, int artefact,
               const std::vector<std::string>& runtimes)
      : word_(manifest.command[0]),
        image_(manifest.image.has_value()),
        folder_(image_ ? manifest.image->working_dir : kPolicy),
        view_(artefact, runtimes, image_),
        path_(image_ ? ImagePath(*manifest.image) : PolicyPath(runtimes)) {}

  absl::Status Run() const {
    if (word_.find('/') != std::string::npos) {
      return Check(word_[0] == '/' ? word_ : absl::StrCat(folder_, "/", word_), 0);
    }
    const std::string place = OnPath(word_);
    if (!place.empty()) return Check(place, 0);
    if (image_) {
      return Refused(absl::StrCat("is in none of the image's program folders: ",
                                  absl::StrJoin(path_, ", "), "; set PATH in its ENV"));
    }
    return Refused(absl::StrCat("is neither a file of the submission nor a program of the "
                                "sandbox, which has programs in ", absl::StrJoin(path_, ", "),
                                "; add the file, or name a program of Debian, of a runtime or of "
                                "the submission"));
  }

 private:
  // Where a bare word is found, "" if nowhere.
  std::string OnPath(const std::string& word) const {
    std::string missing;
    for (const std::string& folder : path_) {
      const std::string place = absl::StrCat(folder, "/", word);
      const std::optional<Found> found = view_.Find(place, missing);
      if (found && S_ISREG(found->mode) && (found->mode & 0111) != 0) return place;
    }
    return "";
  }

  // `path`: absolute, in the sandbox. `depth`: number of scripts that led here.
  absl::Status Check(const std::string& path, int depth) const {
    std::string missing;
    const std::optional<Found> found = view_.Find(path, missing);
    const std::string start =
        depth == 0 ? "" : absl::StrCat("is a script for ", Quoted(path), ", which ");
    if (!found) return Refused(absl::StrCat(start, Absent(path, missing)));
    if (!S_ISREG(found->mode)) {
      return Refused(absl::StrCat(start, S_ISDIR(found->mode) ? "is a folder, not a program"
                                                              : "is not a file that can be run"));
    }
    if ((found->mode & 0111) == 0) {
      return Refused(absl::StrCat(start, "is not executable; set its bit with chmod +x"));
    }
    RETURN_IF_ERROR(CheckVenv(path, *found));
    const Fd file = view_.Open(found->path);
    const ProgramHead head = file.valid() ? ReadProgramHead(file.get()) : ProgramHead{};
    switch (head.kind) {
      case ProgramHead::Kind::kForeign:
        return Refused(absl::StrCat(start, "is a program for ", head.processor,
                                    ", which this host can't run; build it for this host's "
                                    "processor"));
      case ProgramHead::Kind::kBinary:
        if (head.interpreter.empty() || view_.Find(head.interpreter, missing)) break;
        return Refused(absl::StrCat(start, "needs the dynamic loader ", Quoted(head.interpreter),
                                    ", which the ",
                                    image_ ? "image does not have; add it, or "
                                           : "sandbox does not have; build it on Debian 12, or ",
                                    "link it statically"));
      case ProgramHead::Kind::kScript:
        if (head.windows_line_end) return Refused(absl::StrCat(start, kWindowsLineEnds));
        return CheckInterpreter(head, depth);
      case ProgramHead::Kind::kText:
        break;
    }
    return absl::OkStatus();
  }

  absl::Status CheckInterpreter(const ProgramHead& head, int depth) const {
    if (head.interpreter.empty() || depth >= kMaxInterpreters) return absl::OkStatus();
    const std::string interpreter = head.interpreter[0] == '/'
                                        ? head.interpreter
                                        : absl::StrCat(folder_, "/", head.interpreter);
    RETURN_IF_ERROR(Check(interpreter, depth + 1));
    // "env python3" looks up the next word in turn; env's own options are not interpreted here.
    const std::string next = head.argument.substr(0, head.argument.find_first_of(" \t="));
    if (!interpreter.ends_with("/env") || next.empty() || next[0] == '-' ||
        next.find('/') != std::string::npos || !OnPath(next).empty()) {
      return absl::OkStatus();
    }
    return Refused(absl::StrCat("is a script for ", Quoted(next), ", which is in none of the "
                                "sandbox's program folders: ", absl::StrJoin(path_, ", ")));
  }

  // A Python virtual environment finds its library through the file pyvenv.cfg beside or above the
  // name that Python was started by, and its packages in the lib folder of exactly its version.
  absl::Status CheckVenv(const std::string& path, const Found& interpreter) const {
    const std::filesystem::path name = std::filesystem::path(path).lexically_normal();
    const std::string venv = name.parent_path().parent_path().string();
    std::string missing;
    if (image_ || !IsAtOrBelow(venv, kPolicy)) return absl::OkStatus();
    const std::optional<Found> config = view_.Find(venv + "/pyvenv.cfg", missing);
    if (!config || !S_ISREG(config->mode)) return absl::OkStatus();
    const std::string place = venv == kPolicy ? "." : venv.substr(sizeof(kPolicy));
    const std::string home = ReadVenvHome(config->path);
    if (!home.empty() && !view_.Find(home, missing)) {
      return Refused(absl::StrCat("belongs to the virtual environment ", Quoted(place),
                                  ", whose Python is in ", Quoted(home), ", which the sandbox "
                                  "does not have; create it with /usr/bin/python3 -m venv"));
    }
    const std::string version = std::filesystem::path(interpreter.path).filename().string();
    const bool versioned = version.starts_with("python") && version.find('.') != std::string::npos;
    if (!versioned || view_.Find(absl::StrCat(venv, "/lib/", version), missing)) {
      return absl::OkStatus();
    }
    return Refused(absl::StrCat("is ", version, " here, but the virtual environment ",
                                Quoted(place), " has no lib/", version, ": it was created for "
                                "another version of Python; create it with this one"));
  }

  // The value of "home" in a pyvenv.cfg, "" if there is none.
  std::string ReadVenvHome(const std::string& path) const {
    const Fd file = view_.Open(path);
    const std::string text = ReadAll(file.get(), path, kMaxVenvConfig).value_or("");
    for (const absl::string_view line : absl::StrSplit(text, '\n')) {
      const std::pair<absl::string_view, absl::string_view> entry =
          absl::StrSplit(line, absl::MaxSplits('=', 1));
      if (absl::StripAsciiWhitespace(entry.first) == "home") {
        return std::string(absl::StripAsciiWhitespace(entry.second));
      }
    }
    return "";
  }

  std::string Absent(const std::string& path, const std::string& missing) const {
    if (image_) {
      return absl::StrCat("needs ", Quoted(missing), ", which the image does not have",
                          IsReplacedByTheSandbox(missing.substr(1, missing.find('/', 1) - 1))
                              ? ": /dev, /myograde, /proc and /tmp are the sandbox's own"
                              : "");
    }
    const std::string place = std::filesystem::path(path).lexically_normal().string();
    if (missing == place) {
      return absl::StrCat("does not exist: the sandbox has the submission in ", kPolicy,
                          ", the host's /usr and the runtimes that policy.json names");
    }
    return absl::StrCat("leads to ", Quoted(missing), ", which the sandbox does not have: it has "
                        "the submission in ", kPolicy, ", the host's /usr and the runtimes that "
                        "policy.json names");
  }

  absl::Status Refused(const std::string& rule) const {
    return absl::InvalidArgumentError(
        absl::StrCat("policy.json: \"command\" starts with ", Quoted(word_), ", which ", rule));
  }

  const std::string word_;
  const bool image_;
  const std::string folder_;  // where it starts
  const SandboxView view_;
  const std::vector<std::string> path_;
};

}  // namespace

absl::Status CheckProgram(const PolicyManifest& manifest, const std::string& folder,
                          const std::vector<std::string>& runtimes) {
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!root.valid()) return HostError(absl::StrCat("can't open the folder ", folder));
  if (!manifest.image.has_value()) return ProgramCheck(manifest, root.get(), runtimes).Run();
  const Fd image = OpenBeneath(root.get(), kImageFolder, O_PATH | O_DIRECTORY);
  if (!image.valid()) return HostError(absl::StrCat("can't open the image in ", folder));
  RETURN_IF_ERROR(CheckImageMounts(image.get(), runtimes));
  return ProgramCheck(manifest, image.get(), runtimes).Run();
}

}  // namespace myograde::server
