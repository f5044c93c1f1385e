#include <archive.h>
#include <archive_entry.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <memory>
#include <set>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/sha256.h"
#include "server/artefact/artefact.h"
#include "server/artefact/beneath.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

class Unpacker {
 public:
  Unpacker(archive* reader, int root, const ArtefactLimits& limits)
      : reader_(reader), root_(root), listing_(limits) {}

  // Takes the entry whose header was just read.
  absl::Status Take(archive_entry* entry);

  const Listing& listing() const { return listing_; }

 private:
  absl::Status TakeFile(const std::string& path, archive_entry* entry);
  absl::Status MakeFolder(const std::string& path);
  absl::Status CopyContent(const std::string& path, int fd, Entry& file);
  // The folder that holds `path`, opened; made with those above it if missing.
  absl::StatusOr<Fd> FolderOf(const std::string& path);

  archive* reader_;
  int root_;
  Listing listing_;
  std::set<std::string> made_;  // folders
};

std::string_view BaseName(const std::string& path) {
  const size_t slash = path.rfind('/');
  return std::string_view(path).substr(slash == std::string::npos ? 0 : slash + 1);
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

absl::Status Unpacker::Take(archive_entry* entry) {
  const char* raw = archive_entry_pathname(entry);
  if (raw == nullptr) {
    return absl::InvalidArgumentError("an entry of the archive has no name that is UTF-8");
  }
  absl::StatusOr<std::string> path = listing_.CleanPath(raw);
  if (!path.ok()) return path.status();
  if (archive_entry_hardlink(entry) != nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(*path), " is a hard link; put the file itself there"));
  }
  const mode_t type = archive_entry_filetype(entry);
  if ((archive_entry_perm(entry) & (S_ISUID | S_ISGID)) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(*path), " has the setuid or setgid bit; remove it with chmod a-s"));
  }
  if (type == AE_IFDIR) return path->empty() ? absl::OkStatus() : MakeFolder(*path);
  if (path->empty()) {
    return absl::InvalidArgumentError("the archive's top is not a folder");
  }
  if (type == AE_IFREG) return TakeFile(*path, entry);
  if (type != AE_IFLNK) {
    return absl::InvalidArgumentError(
        absl::StrCat("the entry ", Quoted(*path), " is ", std::string(KindName(type)),
                     "; only files, folders and symbolic links are allowed"));
  }
  const char* target = archive_entry_symlink(entry);
  const absl::Status good_target = CheckLinkTarget(*path, target == nullptr ? "" : target);
  if (!good_target.ok()) return good_target;
  absl::StatusOr<Entry*> link = listing_.Add(*path, EntryType::kLink);
  if (!link.ok()) return link.status();
  (*link)->target = target;
  const absl::StatusOr<Fd> folder = FolderOf(*path);
  if (!folder.ok()) return folder.status();
  if (::symlinkat(target, folder->get(), std::string(BaseName(*path)).c_str()) != 0) {
    return HostError(absl::StrCat("can't make the link ", Quoted(*path)));
  }
  return absl::OkStatus();
}

absl::Status Unpacker::MakeFolder(const std::string& path) {
  absl::StatusOr<Entry*> entry = listing_.Add(path, EntryType::kFolder);
  if (!entry.ok()) return entry.status();
  return FolderOf(path + "/").status();
}

absl::StatusOr<Fd> Unpacker::FolderOf(const std::string& path) {
  std::string folder;
  for (size_t slash = path.find('/'); slash != std::string::npos;
       slash = path.find('/', slash + 1)) {
    const std::string above = folder;
    folder = path.substr(0, slash);
    if (!made_.insert(folder).second) continue;
    const Fd parent = OpenBeneath(root_, above.empty() ? "." : above, O_PATH | O_DIRECTORY);
    const std::string name(BaseName(folder));
    if (!parent.valid() || ::mkdirat(parent.get(), name.c_str(), 0755) != 0 ||
        ::fchmodat(parent.get(), name.c_str(), 0755, 0) != 0) {
      return HostError(absl::StrCat("can't make the folder ", Quoted(folder)));
    }
  }
  Fd opened = OpenBeneath(root_, folder.empty() ? "." : folder, O_PATH | O_DIRECTORY);
  if (!opened.valid()) return HostError(absl::StrCat("can't open the folder ", Quoted(folder)));
  return opened;
}

absl::Status Unpacker::TakeFile(const std::string& path, archive_entry* entry) {
  absl::StatusOr<Entry*> file = listing_.Add(path, EntryType::kFile);
  if (!file.ok()) return file.status();
  (*file)->executable = (archive_entry_perm(entry) & 0111) != 0;
  const absl::StatusOr<Fd> folder = FolderOf(path);
  if (!folder.ok()) return folder.status();
  const Fd fd(::openat(folder->get(), std::string(BaseName(path)).c_str(),
                       O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!fd.valid()) return HostError(absl::StrCat("can't make the file ", Quoted(path)));
  const absl::Status copied = CopyContent(path, fd.get(), **file);
  if (!copied.ok()) return copied;
  if (::fchmod(fd.get(), (*file)->executable ? 0755 : 0644) != 0) {
    return HostError(absl::StrCat("can't set the mode of ", Quoted(path)));
  }
  return absl::OkStatus();
}

absl::Status Unpacker::CopyContent(const std::string& path, int fd, Entry& file) {
  Sha256 hash;
  std::string buffer(64 << 10, '\0');
  for (;;) {
    // Counted as it comes: the size that a header claims proves nothing. The
    // gaps of sparse files arrive here as zeros and count too.
    const la_ssize_t got = archive_read_data(reader_, buffer.data(), buffer.size());
    if (got < 0) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the archive is broken in the entry ", Quoted(path), ": ",
          archive_error_string(reader_) != nullptr ? archive_error_string(reader_) : "unreadable"));
    }
    if (got == 0) break;
    const absl::Status counted = listing_.AddBytes(path, got);
    if (!counted.ok()) return counted;
    hash.Update(std::string_view(buffer.data(), static_cast<size_t>(got)));
    for (la_ssize_t done = 0; done < got;) {
      const ssize_t put = ::write(fd, buffer.data() + done, static_cast<size_t>(got - done));
      if (put < 0 && errno == EINTR) continue;
      if (put <= 0) return HostError(absl::StrCat("can't write the file ", Quoted(path)));
      done += put;
    }
    file.size += got;
  }
  file.sha256 = hash.FinishHex();
  return absl::OkStatus();
}

absl::Status CheckLimits(const ArtefactLimits& limits) {
  if (limits.bytes < 1 || limits.files < 1 || limits.depth < 1 || limits.name_bytes < 1) {
    return absl::FailedPreconditionError("every limit of a submission must be at least 1");
  }
  return absl::OkStatus();
}

// The reader with the kinds of archive that are documented, and no others:
// each further parser of libarchive is one more for hostile bytes to try.
std::unique_ptr<archive, ArchiveReader> MakeReader() {
  std::unique_ptr<archive, ArchiveReader> reader(archive_read_new());
  archive_read_support_filter_gzip(reader.get());
  archive_read_support_filter_zstd(reader.get());
  archive_read_support_format_tar(reader.get());
  archive_read_support_format_zip(reader.get());
  return reader;
}

absl::StatusOr<Artefact> UnpackInto(const std::string& path, const std::string& destination,
                                    const ArtefactLimits& limits) {
  const Utf8Names utf8_names;
  const auto reader = MakeReader();
  const Fd root(::open(destination.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!root.valid() || ::fchmod(root.get(), 0755) != 0) {
    return HostError(absl::StrCat("can't open the folder ", destination));
  }
  const auto broken = [&](std::string_view what) {
    const char* why = archive_error_string(reader.get());
    return absl::InvalidArgumentError(absl::StrCat(absl::string_view(what.data(), what.size()), ": ",
                                                   why != nullptr ? why : "unreadable"));
  };
  const Fd input(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!input.valid()) return HostError(absl::StrCat("can't open the archive ", path));
  if (archive_read_open_fd(reader.get(), input.get(), 64 << 10) != ARCHIVE_OK) {
    return broken("this is no archive of a kind that is accepted (tar, tar.gz, tar.zst, zip)");
  }
  Unpacker unpacker(reader.get(), root.get(), limits);
  for (;;) {
    archive_entry* entry = nullptr;
    const int result = archive_read_next_header(reader.get(), &entry);
    if (result == ARCHIVE_EOF) break;
    if (result == ARCHIVE_RETRY) continue;
    if (result != ARCHIVE_OK && result != ARCHIVE_WARN) {
      return broken(
          "the archive is broken or of a kind that is not accepted (tar, tar.gz, tar.zst, zip)");
    }
    const absl::Status taken = unpacker.Take(entry);
    if (!taken.ok()) return taken;
  }
  absl::StatusOr<ArtefactManifest> manifest = ReadManifest(destination);
  if (!manifest.ok()) return manifest.status();
  const Listing& listing = unpacker.listing();
  return Artefact{.digest = listing.Digest(),
                  .manifest = *std::move(manifest),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

}  // namespace

absl::StatusOr<Artefact> UnpackArtefact(const std::string& archive, const std::string& destination,
                                        const ArtefactLimits& limits) {
  const absl::Status good_limits = CheckLimits(limits);
  if (!good_limits.ok()) return good_limits;
  if (::mkdir(destination.c_str(), 0755) != 0) {
    return HostError(absl::StrCat("can't make the folder ", destination));
  }
  absl::StatusOr<Artefact> artefact = UnpackInto(archive, destination, limits);
  if (!artefact.ok()) {
    std::error_code ignored;  // the first error is the one to tell
    std::filesystem::remove_all(destination, ignored);
  }
  return artefact;
}

}  // namespace myograde::server
