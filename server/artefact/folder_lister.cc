#include "server/artefact/folder_lister.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <climits>
#include <cstring>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"

namespace myograde::server {
namespace {

struct CloseFolder {
  void operator()(DIR* folder) const { ::closedir(folder); }
};

class FolderLister {
 public:
  FolderLister(int root, FolderOf whose, Listing& listing)
      : root_(root), submitted_(whose == FolderOf::kParticipant), listing_(listing) {}

  // `folder` is "" for the top.
  absl::Status List(const std::string& folder) {
    Fd fd = OpenBeneath(root_, folder.empty() ? "." : folder, O_RDONLY | O_DIRECTORY);
    if (!fd.valid()) return Unreadable(folder.empty() ? "the folder" : folder);
    const std::unique_ptr<DIR, CloseFolder> names(::fdopendir(fd.get()));
    if (names == nullptr) return Unreadable(folder);
    const int at = fd.release();  // `names` closes it
    for (;;) {
      errno = 0;
      const dirent* name = ::readdir(names.get());
      if (name == nullptr) return errno == 0 ? absl::OkStatus() : Unreadable(folder);
      const std::string base = name->d_name;
      if (base == "." || base == "..") continue;
      RETURN_IF_ERROR(Take(at, base, folder.empty() ? base : folder + "/" + base));
    }
  }

 private:
  absl::Status Unreadable(const std::string& path) const {
    if (!submitted_) return HostError(absl::StrCat("can't read ", Quoted(path)));
    return absl::InvalidArgumentError(
        absl::StrCat(Quoted(path), " can't be read: ", std::strerror(errno)));
  }

  absl::Status Take(int at, const std::string& base, const std::string& raw_path) {
    ASSIGN_OR_RETURN(const std::string path, listing_.CleanPath(raw_path));
    struct stat info = {};
    if (::fstatat(at, base.c_str(), &info, AT_SYMLINK_NOFOLLOW) != 0) return Unreadable(path);
    if (S_ISDIR(info.st_mode)) {
      RETURN_IF_ERROR(listing_.Add(path, EntryType::kFolder).status());
      return List(path);
    }
    if (S_ISLNK(info.st_mode)) return TakeLink(at, base, path);
    if (!S_ISREG(info.st_mode)) {
      const std::string what = absl::StrCat(Quoted(path), " is no file, folder or symbolic link");
      return submitted_ ? absl::InvalidArgumentError(absl::StrCat(what, "; remove it"))
                        : absl::DataLossError(absl::StrCat("the submission's ", what));
    }
    if (submitted_ && (info.st_mode & (S_ISUID | S_ISGID)) != 0) {
      return absl::InvalidArgumentError(absl::StrCat(
          Quoted(path), " has the setuid or setgid bit; remove it with chmod a-s"));
    }
    ASSIGN_OR_RETURN(Entry* const entry, listing_.Add(path, EntryType::kFile));
    entry->size = info.st_size;
    entry->time = KeptTime(info.st_mtim.tv_sec);
    entry->executable = (info.st_mode & 0111) != 0;
    return listing_.AddBytes(path, info.st_size);
  }

  absl::Status TakeLink(int at, const std::string& base, const std::string& path) {
    std::array<char, PATH_MAX> target;
    const ssize_t size = ::readlinkat(at, base.c_str(), target.data(), target.size());
    if (size < 0) return Unreadable(path);
    const std::string text(target.data(), static_cast<size_t>(size));
    // An image's links lead where they like.
    if (submitted_) RETURN_IF_ERROR(CheckLinkTarget(path, text));
    ASSIGN_OR_RETURN(Entry* const entry, listing_.Add(path, EntryType::kLink));
    entry->target = text;
    return absl::OkStatus();
  }

  const int root_;
  const bool submitted_;
  Listing& listing_;
};

}  // namespace

absl::Status ListFolder(int root, FolderOf whose, Listing& listing) {
  return FolderLister(root, whose, listing).List("");
}

}  // namespace myograde::server
