#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <optional>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/strings/str_split.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/listing.h"
#include "server/sandbox/policy_sandbox.h"

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
      absl::StrCat("can't mount the unpacked image in a sandbox: ", path, " ", what));
}

// The image's own doing.
absl::Status Unshowable(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(
      absl::StrCat("can't mount the image in a sandbox: ", path, " ", what));
}

// Shows the entries of an image's folder at their places.
class ImageMounts {
 public:
  ImageMounts(int root, std::string staged, const std::vector<std::string>& runtimes,
              SandboxSpec& spec)
      : root_(root), staged_(std::move(staged)), runtimes_(runtimes), spec_(spec) {}

  // `folder`: "" for the top.
  absl::Status ShowAll(const std::string& folder) {
    const Fd opened = OpenBeneath(root_, folder.empty() ? "." : folder, O_RDONLY | O_DIRECTORY);
    const auto names = opened.valid() ? NamesIn(opened.get()) : std::nullopt;
    if (!names.has_value()) return Unreadable("/" + folder, "can't be read");
    for (const std::string& name : *names) {
      if (folder.empty() && IsReplacedByTheSandbox(name)) continue;
      RETURN_IF_ERROR(Show(Joined(folder, name)));
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
    if (std::ranges::find(runtimes_, place) != runtimes_.end()) return absl::OkStatus();
    if (HoldsRuntime(place)) return S_ISDIR(info.st_mode) ? ShowAll(path) : absl::OkStatus();
    if (S_ISLNK(info.st_mode)) return ShowLink(fd.get(), path);
    if (!S_ISDIR(info.st_mode) && !S_ISREG(info.st_mode)) {
      return Unshowable(place, "is neither a file, a folder nor a link");
    }
    if (place == "/etc" && !IsSafe(path)) {
      return Unshowable(place, "is not a folder, or has an ld.so.preload; set LD_PRELOAD in its ENV");
    }
    spec_.mounts.push_back({Kind::kReadOnly, staged_ + place, place});
    return absl::OkStatus();
  }

  absl::Status ShowLink(int link, const std::string& path) {
    // Through a link, files of the grader's programs could be the image's.
    if (path == "etc") return Unshowable("/etc", "is a link; make it a folder");
    const std::string target = TargetOf(link);
    if (target.empty()) return Unreadable("/" + path, "is a link that can't be read");
    spec_.mounts.push_back({Kind::kSymlink, target, "/" + path});
    return absl::OkStatus();
  }

  // Without runtimes there can't be as many: the unpacking limits the names at the top.
  absl::Status TooMany(const std::string& path) const {
    return absl::InvalidArgumentError(absl::StrCat(
        "the image has more than ", kMaxImageMounts, " names along the path to a runtime of "
        "policy.json, the last of them in ", Quoted("/" + FolderName(path)),
        "; leave \"runtimes\" out and "
        "install its packages in the image, or put those files into a subfolder"));
  }

  // The loader of the grader's programs loads what /etc/ld.so.preload names.
  bool IsSafe(const std::string& etc) const {
    const Fd folder = OpenBeneath(root_, etc, O_PATH | O_DIRECTORY);
    struct stat info = {};
    return folder.valid() &&
           ::fstatat(folder.get(), "ld.so.preload", &info, AT_SYMLINK_NOFOLLOW) != 0 &&
           errno == ENOENT;
  }

  bool HoldsRuntime(const std::string& place) const {
    return std::ranges::any_of(
        runtimes_, [&](const std::string& runtime) { return runtime.starts_with(place + "/"); });
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

}  // namespace myograde::server
