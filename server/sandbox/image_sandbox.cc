#include "server/sandbox/image_sandbox.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <climits>
#include <filesystem>
#include <set>

#include <absl/strings/match.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

using Kind = SandboxMount::Kind;

constexpr char kLoader[] = "/lib64/ld-linux-x86-64.so.2";
constexpr char kDefaultPath[] = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin";
// Each is a mount, which takes the kernel some 0.1 ms.
constexpr size_t kMaxImageMounts = 512;

// A path of this host without links, as it is seen below kHostPlace, where the target of an absolute link
// would be the image's.
std::string OnHost(const std::string& path) {
  std::error_code error;
  const std::string real = std::filesystem::canonical(path, error).string();
  return kHostPlace + (error ? path : real);
}

// The host's trouble: files that the unpacking left can't be read.
absl::Status Unreadable(const std::string& path, const std::string& what) {
  return absl::FailedPreconditionError(
      absl::StrCat("the unpacked image can't be shown in a sandbox: ", path, " ", what));
}

// The image's own doing.
absl::Status Unshowable(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(
      absl::StrCat("the image can't be shown in a sandbox: ", path, " ", what));
}

// Shows the entries of an image's folder at their places.
class ImageMounts {
 public:
  ImageMounts(int root, std::string staged, const std::vector<std::string>& runtimes,
              SandboxSpec& spec)
      : root_(root), staged_(std::move(staged)), runtimes_(runtimes), spec_(spec) {}

  // `folder`: "" for the top.
  absl::Status ShowAll(const std::string& folder) {
    Fd opened = OpenBeneath(root_, folder.empty() ? "." : folder, O_RDONLY | O_DIRECTORY);
    DIR* names = opened.valid() ? ::fdopendir(opened.get()) : nullptr;
    if (names == nullptr) return Unreadable("/" + folder, "can't be read");
    opened.release();  // `names` closes it
    std::set<std::string> sorted;
    while (const dirent* name = ::readdir(names)) sorted.insert(name->d_name);
    ::closedir(names);
    for (const std::string& name : sorted) {
      if (name == "." || name == "..") continue;
      if (folder.empty() && IsReplacedByTheSandbox(name)) continue;
      RETURN_IF_ERROR(Show(folder.empty() ? name : folder + "/" + name));
    }
    return absl::OkStatus();
  }

 private:
  absl::Status Show(const std::string& path) {
    if (++mounts_ > kMaxImageMounts) return TooMany(path);
    const Fd fd = OpenBeneath(root_, path, O_PATH);
    struct stat info = {};
    if (!fd.valid() || ::fstat(fd.get(), &info) != 0) {
      return Unreadable("/" + path, "can't be opened");
    }
    const std::string place = "/" + path;
    // A runtime is mounted there; its folders must be real ones.
    if (IsRuntime(place)) return absl::OkStatus();
    if (HoldsRuntime(place)) return S_ISDIR(info.st_mode) ? ShowAll(path) : absl::OkStatus();
    if (S_ISLNK(info.st_mode)) return ShowLink(fd.get(), path);
    if (!S_ISDIR(info.st_mode) && !S_ISREG(info.st_mode)) {
      return Unshowable(place, "is neither a file, a folder nor a link");
    }
    if (place == "/etc" && !IsHarmless(path)) {
      return Unshowable(place, "is no folder, or has an ld.so.preload; set LD_PRELOAD in its ENV");
    }
    spec_.mounts.push_back({Kind::kReadOnly, staged_ + place, place});
    return absl::OkStatus();
  }

  absl::Status ShowLink(int link, const std::string& path) {
    // Through a link, files of the grader's programs could be the image's.
    if (path == "etc") return Unshowable("/etc", "is a link; make it a folder");
    std::string target(PATH_MAX, '\0');
    const ssize_t size = ::readlinkat(link, "", target.data(), target.size());
    if (size <= 0) return Unreadable("/" + path, "is a link that can't be read");
    target.resize(static_cast<size_t>(size));
    spec_.mounts.push_back({Kind::kSymlink, target, "/" + path});
    return absl::OkStatus();
  }

  // Without runtimes there can't be as many: the unpacking limits the names at the top.
  absl::Status TooMany(const std::string& path) const {
    const size_t slash = path.rfind('/');
    const std::string folder = path.substr(0, slash == std::string::npos ? 0 : slash);
    return absl::InvalidArgumentError(absl::StrCat(
        "the image has more than ", kMaxImageMounts, " names on the way to a runtime of policy.json, "
        "the last of them in ", Quoted("/" + folder), "; leave \"runtimes\" out and install its "
        "packages in the image, or put those files into a subfolder"));
  }

  // The loader of the grader's programs loads what /etc/ld.so.preload names.
  bool IsHarmless(const std::string& etc) const {
    const Fd folder = OpenBeneath(root_, etc, O_PATH | O_DIRECTORY);
    struct stat info = {};
    return folder.valid() &&
           ::fstatat(folder.get(), "ld.so.preload", &info, AT_SYMLINK_NOFOLLOW) != 0 &&
           errno == ENOENT;
  }

  bool IsRuntime(const std::string& place) const {
    for (const std::string& runtime : runtimes_) {
      if (runtime == place) return true;
    }
    return false;
  }

  bool HoldsRuntime(const std::string& place) const {
    for (const std::string& runtime : runtimes_) {
      if (absl::StartsWith(runtime, place + "/")) return true;
    }
    return false;
  }

  const int root_;
  const std::string staged_;
  const std::vector<std::string>& runtimes_;
  SandboxSpec& spec_;
  size_t mounts_ = 0;
};

}  // namespace

std::vector<std::string> LoaderCommand(const std::string& path, const std::string& name) {
  const std::string loader = OnHost(kLoader);
  const std::vector<std::string> folders = {loader.substr(0, loader.rfind('/')),
                                            absl::StrCat(kHostPlace, "/usr/lib"),
                                            absl::StrCat(kHostPlace, "/usr/local/lib")};
  return {loader,    "--inhibit-cache", "--library-path", absl::StrJoin(folders, ":"),
          "--argv0", name,              path};
}

std::vector<std::string> HostCommand(const std::string& program) {
  return LoaderCommand(OnHost(program), OnHost(program));
}

absl::Status AddImage(const LeaseOrder& order, const Stage& stage, SandboxSpec& spec) {
  const std::string staged = absl::StrCat(stage.PathOf(order.artefact_dir), "/", kImageFolder);
  const Fd root(::open(staged.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!root.valid()) return Unreadable("/", "is missing");
  RETURN_IF_ERROR(ImageMounts(root.get(), staged, order.runtimes, spec).ShowAll(""));
  spec.mounts.push_back({Kind::kReadOnly, "/usr", absl::StrCat(kHostPlace, "/usr")});
  return absl::OkStatus();
}

absl::Status CheckImageMounts(int root, const std::vector<std::string>& runtimes) {
  SandboxSpec unused;
  return ImageMounts(root, "", runtimes, unused).ShowAll("");
}

std::vector<std::string> ImagePath(const PolicyImage& image) {
  const auto path = image.environment.find("PATH");
  const std::string folders = path == image.environment.end() ? kDefaultPath : path->second;
  return absl::StrSplit(folders, ':');
}

std::vector<std::string> AgentEnvironment(const LeaseOrder& order) {
  // Programs that ask for the user's name find it here if the image does not know its number.
  std::map<std::string, std::string> all;
  if (order.image.has_value()) {
    all = {{"USER", "policy"}, {"LOGNAME", "policy"}};
    for (const auto& [name, value] : order.image->environment) all[name] = value;
  }
  for (const auto& [name, value] : order.environment) all[name] = value;
  std::vector<std::string> variables;
  for (const auto& [name, value] : all) variables.push_back(absl::StrCat(name, "=", value));
  return variables;
}

}  // namespace myograde::server
