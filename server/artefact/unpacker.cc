#include "server/artefact/unpacker.h"

#include <archive_entry.h>
#include <sys/stat.h>

#include <cerrno>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"

namespace myograde::server {
namespace {

constexpr size_t kBlockBytes = 64 << 10;

// Whether the host failed to read, which says nothing about the archive.
bool HostFailed(archive* reader) {
  for (const int error : {EIO, EBADF, ENODEV, ENXIO, ESTALE}) {
    if (archive_errno(reader) != error) continue;
    errno = error;
    return true;
  }
  return false;
}

std::string_view KindName(mode_t type) {
  switch (type) {
    case AE_IFBLK:
    case AE_IFCHR:
      return "a device node";
    case AE_IFIFO:
      return "a named pipe";
    case AE_IFSOCK:
      return "a socket";
    default:
      return "of an unknown kind";
  }
}

// What no entry of a submission may be, and what to do about it; "": it is nothing of this.
std::string Forbidden(archive_entry* entry) {
  const mode_t mode = archive_entry_perm(entry);
  if (archive_entry_hardlink(entry) != nullptr) {
    return "is a hard link; put the file itself there";
  }
  if ((mode & (S_ISUID | S_ISGID)) != 0) {
    return "has the setuid or setgid bit; remove it with chmod a-s";
  }
  if ((mode & S_ISVTX) != 0) return "has the sticky bit; remove it with chmod -t";
  if (archive_entry_is_encrypted(entry) != 0) {
    return "is encrypted; make the archive without a password";
  }
  const mode_t type = archive_entry_filetype(entry);
  if (type == AE_IFDIR || type == AE_IFREG || type == AE_IFLNK) return "";
  return absl::StrCat("is ", std::string(KindName(type)),
                      "; only files, folders and symbolic links are allowed");
}

}  // namespace

absl::Status Unpacker::Failure(absl::string_view what) const {
  if (HostFailed(reader_)) return HostError("can't read the archive");
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", ArchiveReason(reader_)));
}

absl::Status Unpacker::UnpackAll() {
  for (;;) {
    archive_entry* entry = nullptr;
    const int result = archive_read_next_header(reader_, &entry);
    if (result == ARCHIVE_EOF) return absl::OkStatus();
    // Also for ARCHIVE_RETRY: libarchive would continue after a damaged header, and a file would be
    // missing.
    if (result != ARCHIVE_OK && result != ARCHIVE_WARN) {
      return Failure(
          "the archive is broken or of a kind that is not accepted (tar, tar.gz, tar.zst, "
          "tar.xz, tar.bz2, zip)");
    }
    RETURN_IF_ERROR(Take(entry));
  }
}

absl::Status Unpacker::Take(archive_entry* entry) {
  // The top folder may be named any number of times without being listed.
  if (++headers_ > limits_.files + 1) return listing_.TooManyEntries(std::string_view("./"));
  const char* raw = archive_entry_pathname(entry);
  if (raw == nullptr) {
    return absl::InvalidArgumentError("an entry of the archive has no name that is UTF-8");
  }
  ASSIGN_OR_RETURN(const std::string path, listing_.CleanPath(raw));
  if (const std::string what = Forbidden(entry); !what.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("the entry ", Quoted(path), " ", what));
  }
  const mode_t type = archive_entry_filetype(entry);
  if (path.empty()) {
    return type == AE_IFDIR ? absl::OkStatus()
                            : absl::InvalidArgumentError("the archive's top is not a folder");
  }
  if (type == AE_IFREG) return TakeFile(path, entry);
  if (type == AE_IFDIR) {
    RETURN_IF_ERROR(listing_.Add(path, EntryType::kFolder).status());
    return MakeFoldersOf(path + "/");
  }
  const char* text = archive_entry_symlink(entry);
  const std::string target = text == nullptr ? "" : text;
  // An image's links lead where they like.
  RETURN_IF_ERROR(submitted_ ? CheckLinkTarget(path, target) : CheckLinkText(path, target));
  ASSIGN_OR_RETURN(Entry* const link, listing_.Add(path, EntryType::kLink));
  link->target = target;
  RETURN_IF_ERROR(MakeFoldersOf(path));
  return MakeLinkBeneath(root_, path, target);
}

// Makes the folders above `path` that are missing.
absl::Status Unpacker::MakeFoldersOf(const std::string& path) {
  for (size_t slash = path.find('/'); slash != std::string::npos;
       slash = path.find('/', slash + 1)) {
    const std::string folder = path.substr(0, slash);
    if (made_.insert(folder).second) RETURN_IF_ERROR(MakeFolderBeneath(root_, folder));
  }
  return absl::OkStatus();
}

absl::Status Unpacker::TakeFile(const std::string& path, archive_entry* entry) {
  ASSIGN_OR_RETURN(Entry* const file, listing_.Add(path, EntryType::kFile));
  file->executable = (archive_entry_perm(entry) & 0111) != 0;
  // Python uses a compiled module only if its source still has the time recorded in it.
  file->time = KeptTime(archive_entry_mtime(entry));
  // A claimed size proves nothing, but one above the limit can be rejected at once.
  if (archive_entry_size_is_set(entry) != 0) {
    RETURN_IF_ERROR(listing_.CheckRoom(path, archive_entry_size(entry)));
  }
  RETURN_IF_ERROR(MakeFoldersOf(path));
  std::string buffer(kBlockBytes, '\0');
  return MakeFileBeneath(root_, path, *file, [&]() -> absl::StatusOr<std::string_view> {
    if (file->size > 0) read_();
    // Count the bytes as they come: the size in a header proves nothing. The holes of sparse files
    // arrive here as zeros and count too.
    const la_ssize_t got = archive_read_data(reader_, buffer.data(), buffer.size());
    if (got < 0) {
      return Failure(absl::StrCat("the archive is broken in the entry ", Quoted(path)));
    }
    RETURN_IF_ERROR(listing_.AddBytes(path, got));
    const std::string_view piece(buffer.data(), static_cast<size_t>(got));
    if (submitted_ && file->size == 0 &&
        piece.starts_with("version https://git-lfs.github.com/spec/")) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the file ", Quoted(path),
          " is a pointer of Git LFS in place of its content; get that with \"git lfs pull\" before "
          "you pack, or leave the file out"));
    }
    return piece;
  });
}

}  // namespace myograde::server
