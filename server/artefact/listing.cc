#include "server/artefact/listing.h"

#include <dirent.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <functional>
#include <memory>

#include <absl/strings/ascii.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

absl::Status Broken(std::string_view path, absl::string_view rule) {
  return absl::InvalidArgumentError(absl::StrCat("the entry ", Quoted(path), " ", rule));
}

bool HasControlCharacter(std::string_view text) {
  return std::ranges::any_of(text, absl::ascii_iscntrl);
}

// The same, one path component at a time, for kernels and container hosts without openat2.
Fd OpenByNames(int root, const std::string& path, int flags, mode_t mode) {
  Fd folder;
  size_t begin = 0;
  for (;;) {
    const int at = folder.valid() ? folder.get() : root;
    const size_t slash = path.find('/', begin);
    const std::string name = path.substr(begin, slash - begin);
    if (name == ".." || name.empty()) {
      errno = EXDEV;
      return Fd();
    }
    if (slash == std::string::npos) return Fd(::openat(at, name.c_str(), flags, mode));
    Fd next(::openat(at, name.c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
    if (!next.valid()) return Fd();
    folder = std::move(next);
    begin = slash + 1;
  }
}

// Lists one entry, and what is below it.
absl::Status ListEntry(int root, const std::string& raw_path, FolderOf whose, Listing& listing) {
  const bool submitted = whose == FolderOf::kParticipant;
  ASSIGN_OR_RETURN(const std::string path, listing.CleanPath(raw_path));
  const Fd fd = OpenBeneath(root, path, O_PATH);
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0) return Unreadable(path, whose);
  if (S_ISDIR(info.st_mode)) {
    RETURN_IF_ERROR(listing.Add(path, EntryType::kFolder).status());
    return ListFolder(root, whose, listing, path);
  }
  if (S_ISLNK(info.st_mode)) {
    const std::string target = TargetOf(fd.get());
    // An image's links lead where they like.
    if (submitted) RETURN_IF_ERROR(CheckLinkTarget(path, target));
    ASSIGN_OR_RETURN(Entry* const link, listing.Add(path, EntryType::kLink));
    link->target = target;
    return absl::OkStatus();
  }
  if (!S_ISREG(info.st_mode)) {
    const std::string what = absl::StrCat(Quoted(path), " is not a file, folder or symbolic link");
    return submitted ? absl::InvalidArgumentError(absl::StrCat(what, "; remove it"))
                     : absl::DataLossError(absl::StrCat("the submission's ", what));
  }
  if (submitted && (info.st_mode & (S_ISUID | S_ISGID)) != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(Quoted(path), " has the setuid or setgid bit; remove it with chmod a-s"));
  }
  ASSIGN_OR_RETURN(Entry* const entry, listing.Add(path, EntryType::kFile));
  entry->size = info.st_size;
  entry->time = KeptTime(info.st_mtim.tv_sec);
  entry->executable = (info.st_mode & 0111) != 0;
  return listing.AddBytes(path, info.st_size);
}

}  // namespace

std::string Quoted(std::string_view path) {
  constexpr size_t kShown = 120;
  std::string shown(path.substr(0, kShown));
  std::ranges::replace_if(shown, std::not_fn(absl::ascii_isprint), '?');
  return absl::StrCat("\"", shown, path.size() > kShown ? "..." : "", "\"");
}

absl::Status HostError(std::string_view what) {
  const int error = errno;
  const std::string message =
      absl::StrCat(absl::string_view(what.data(), what.size()), ": ", std::strerror(error));
  if (error == ENOSPC || error == EDQUOT) return absl::ResourceExhaustedError(message);
  if (error == ENAMETOOLONG) return absl::InvalidArgumentError(message);
  return absl::UnavailableError(message);
}

absl::StatusOr<std::string> Listing::CleanPath(std::string_view path) const {
  if (path.starts_with('/')) return Broken(path, "has an absolute path; paths must be relative");
  if (HasControlCharacter(path)) return Broken(path, "has a control character in its name");
  if (!IsUtf8(path)) return Broken(path, "has a name that is not UTF-8");
  std::string clean;
  int64_t depth = 0;
  while (!path.empty()) {
    const size_t slash = path.find('/');
    const std::string_view name = path.substr(0, slash);
    path = slash == std::string_view::npos ? "" : path.substr(slash + 1);
    if (name.empty() || name == ".") continue;
    if (name == "..") return Broken(clean + "/..", "has \"..\" in its path, which is not allowed");
    if (static_cast<int64_t>(name.size()) > limits_.name_bytes) {
      return Broken(name, absl::StrCat("has a name of ", name.size(), " bytes; at most ",
                                       limits_.name_bytes, " are allowed"));
    }
    if (++depth > limits_.depth) {
      return Broken(clean, absl::StrCat("is deeper than ", limits_.depth, " folders"));
    }
    if (!clean.empty()) clean += '/';
    clean += name;
  }
  return clean;
}

absl::StatusOr<Entry*> Listing::Add(const std::string& path, EntryType type) {
  for (size_t slash = path.find('/'); slash != std::string::npos;
       slash = path.find('/', slash + 1)) {
    const std::string above = path.substr(0, slash);
    const auto [it, added] = entries_.try_emplace(above, Entry{.type = EntryType::kFolder});
    if (it->second.type != EntryType::kFolder) {
      return Broken(path, absl::StrCat("is below ", Quoted(above), ", which is not a folder"));
    }
  }
  const auto [it, added] = entries_.try_emplace(path, Entry{.type = type});
  Entry& entry = it->second;
  const bool implied_folder = entry.type == EntryType::kFolder && type == EntryType::kFolder;
  if (!added && (entry.stated || !implied_folder)) return Broken(path, "appears twice");
  entry.stated = true;
  if (static_cast<int64_t>(entries_.size()) > limits_.files) {
    return TooManyEntries(path);
  }
  return &entry;
}

absl::Status Listing::TooManyEntries(std::string_view where) const {
  return absl::InvalidArgumentError(
      absl::StrCat("there are more than ", limits_.files, " files, folders and links (at ",
                   Quoted(where), "); leave out what the policy does not need"));
}

absl::Status Listing::CheckRoom(const std::string& path, int64_t bytes) const {
  if (bytes < 0 || bytes > limits_.bytes - bytes_) {
    return absl::InvalidArgumentError(
        absl::StrCat("the files are larger than ", limits_.bytes, " bytes in total, unpacked (at ",
                     Quoted(path), "); leave out what the policy does not need"));
  }
  return absl::OkStatus();
}

absl::Status Listing::AddBytes(const std::string& path, int64_t bytes) {
  const absl::Status fits = CheckRoom(path, bytes);
  if (fits.ok()) bytes_ += bytes;
  return fits;
}

std::string Listing::Digest() const {
  Sha256 hash;
  hash.Update(std::string_view("myograde artefact 1\n"));
  for (const auto& [path, entry] : entries_) {
    nlohmann::json line = {{"path", path}, {"type", "folder"}};
    if (entry.type == EntryType::kFile) {
      line.update({{"type", "file"}, {"executable", entry.executable}, {"size", entry.size},
                   {"sha256", entry.sha256}});
    } else if (entry.type == EntryType::kLink) {
      line.update({{"type", "link"}, {"target", entry.target}});
    }
    hash.Update(CanonicalJson(line) + "\n");
  }
  return hash.FinishHex();
}

int64_t KeptTime(int64_t seconds) { return std::clamp<int64_t>(seconds, 0, UINT32_MAX); }

absl::Status CheckLinkText(std::string_view path, std::string_view target) {
  if (target.empty()) return Broken(path, "is a symbolic link without a target");
  if (HasControlCharacter(target) || !IsUtf8(target)) {
    return Broken(path, "is a symbolic link whose target is not plain UTF-8 text");
  }
  return absl::OkStatus();
}

absl::Status CheckLinkTarget(std::string_view path, std::string_view target) {
  RETURN_IF_ERROR(CheckLinkText(path, target));
  if (target == ".." || target.starts_with("../") || target.ends_with("/..") ||
      target.find("/../") != std::string_view::npos) {
    return Broken(path, absl::StrCat("is a symbolic link to ", Quoted(target),
                                     "; targets with \"..\" are not allowed; put a copy there"));
  }
  return absl::OkStatus();
}

Utf8Names::Utf8Names() : utf8_(::newlocale(LC_CTYPE_MASK, "C.UTF-8", nullptr)) {
  before_ = ::uselocale(utf8_);  // a null locale changes nothing
}

Utf8Names::~Utf8Names() {
  ::uselocale(before_);
  if (utf8_ != nullptr) ::freelocale(utf8_);
}

absl::StatusOr<Fd> MakeFolderToFill(const std::string& path) {
  if (::mkdir(path.c_str(), 0755) != 0) {
    return HostError(absl::StrCat("can't create the folder ", path));
  }
  Fd folder(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (folder.valid() && ::fchmod(folder.get(), 0755) == 0) return folder;
  const absl::Status status = HostError(absl::StrCat("can't open the folder ", path));
  ::rmdir(path.c_str());
  return status;
}

Fd OpenBeneath(int root, const std::string& path, int flags, mode_t mode) {
  flags |= O_CLOEXEC | O_NOFOLLOW;
  struct open_how how = {};
  how.flags = static_cast<unsigned>(flags);
  how.mode = (flags & O_CREAT) != 0 ? mode : 0;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS | RESOLVE_NO_MAGICLINKS;
  const long fd = ::syscall(SYS_openat2, root, path.c_str(), &how, sizeof how);
  if (fd >= 0) return Fd(static_cast<int>(fd));
  if (errno == ENOSYS || errno == EPERM) return OpenByNames(root, path, flags, mode);
  return Fd();
}

absl::StatusOr<Fd> OpenFolderOf(int root, const std::string& path) {
  const std::string folder = path.find('/') == std::string::npos ? "." : FolderName(path);
  Fd opened = OpenBeneath(root, folder, O_PATH | O_DIRECTORY);
  if (!opened.valid()) return HostError(absl::StrCat("can't open the folder ", Quoted(folder)));
  return opened;
}

std::string FolderName(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}

std::string LastName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

std::string Joined(const std::string& folder, const std::string& name) {
  return folder.empty() ? name : folder + "/" + name;
}

std::optional<std::vector<std::string>> NamesIn(int folder) {
  Fd fd(::openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  const std::unique_ptr<DIR, int (*)(DIR*)> entries(fd.valid() ? ::fdopendir(fd.get()) : nullptr,
                                                    ::closedir);
  if (entries == nullptr) return std::nullopt;
  fd.release();  // `entries` closes it
  std::vector<std::string> names;
  for (;;) {
    errno = 0;
    const dirent* entry = ::readdir(entries.get());
    if (entry == nullptr) break;
    const std::string_view name = entry->d_name;
    if (name != "." && name != "..") names.emplace_back(name);
  }
  if (errno != 0) return std::nullopt;
  std::sort(names.begin(), names.end());
  return names;
}

std::string TargetOf(int link) {
  std::array<char, PATH_MAX> target;
  const ssize_t size = ::readlinkat(link, "", target.data(), target.size());
  return std::string(target.data(), static_cast<size_t>(std::max<ssize_t>(size, 0)));
}

absl::Status MakeFolderBeneath(int root, const std::string& path) {
  ASSIGN_OR_RETURN(const Fd folder, OpenFolderOf(root, path));
  const std::string name = LastName(path);
  if (::mkdirat(folder.get(), name.c_str(), 0755) != 0 ||
      ::fchmodat(folder.get(), name.c_str(), 0755, 0) != 0) {
    return HostError(absl::StrCat("can't create the folder ", Quoted(path)));
  }
  return absl::OkStatus();
}

absl::Status MakeLinkBeneath(int root, const std::string& path, const std::string& target) {
  ASSIGN_OR_RETURN(const Fd folder, OpenFolderOf(root, path));
  if (::symlinkat(target.c_str(), folder.get(), LastName(path).c_str()) == 0) {
    return absl::OkStatus();
  }
  return HostError(absl::StrCat("can't create the link ", Quoted(path)));
}

absl::Status MakeFileBeneath(int root, const std::string& path, Entry& entry,
                             const std::function<absl::StatusOr<std::string_view>()>& next) {
  ASSIGN_OR_RETURN(const Fd folder, OpenFolderOf(root, path));
  const Fd file(::openat(folder.get(), LastName(path).c_str(),
                         O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!file.valid()) return HostError(absl::StrCat("can't create the file ", Quoted(path)));
  Sha256 hash;
  for (;;) {
    ASSIGN_OR_RETURN(const std::string_view piece, next());
    if (piece.empty()) break;
    if (!WriteAll(file.get(), piece).ok()) {
      return HostError(absl::StrCat("can't write the file ", Quoted(path)));
    }
    hash.Update(piece);
    entry.size += std::ssize(piece);
  }
  entry.sha256 = hash.FinishHex();
  const timespec time = {entry.time, 0};
  const timespec times[] = {time, time};
  if (::futimens(file.get(), times) != 0 ||
      ::fchmod(file.get(), entry.executable ? 0755 : 0644) != 0) {
    return HostError(absl::StrCat("can't set mode and time of ", Quoted(path)));
  }
  return absl::OkStatus();
}

absl::Status ListFolder(int root, FolderOf whose, Listing& listing, const std::string& folder) {
  const Fd fd = OpenBeneath(root, folder.empty() ? "." : folder, O_RDONLY | O_DIRECTORY);
  const auto names = fd.valid() ? NamesIn(fd.get()) : std::nullopt;
  if (!names.has_value()) return Unreadable(folder.empty() ? "the folder" : folder, whose);
  for (const std::string& name : *names) {
    RETURN_IF_ERROR(ListEntry(root, Joined(folder, name), whose, listing));
  }
  return absl::OkStatus();
}

absl::Status Unreadable(const std::string& path, FolderOf whose) {
  if (whose == FolderOf::kDaemon) return HostError(absl::StrCat("can't read ", Quoted(path)));
  return absl::InvalidArgumentError(
      absl::StrCat(Quoted(path), " can't be read: ", std::strerror(errno)));
}

}  // namespace myograde::server
