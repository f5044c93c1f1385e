#include <archive.h>
#include <archive_entry.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <iterator>
#include <memory>
#include <set>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/archive_errors.h"
#include "server/artefact/artefact.h"
#include "server/artefact/beneath.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/listing.h"
#include "server/artefact/submitted_manifest.h"
#include "server/artefact/unpack_image.h"

namespace myograde::server {
namespace {

// Whether the host failed to read, which says nothing about the archive.
bool HostFailed(archive* reader) {
  for (const int error : {EIO, EBADF, ENODEV, ENXIO, ESTALE}) {
    if (archive_errno(reader) != error) continue;
    errno = error;
    return true;
  }
  return false;
}

class Unpacker {
 public:
  // `read` is called after each block.
  Unpacker(archive* reader, int root, const ArtefactLimits& limits, std::function<void()> read)
      : reader_(reader), root_(root), limits_(limits), read_(std::move(read)), listing_(limits) {}

  // Extracts the entry whose header was just read.
  absl::Status Take(archive_entry* entry);

  const Listing& listing() const { return listing_; }

 private:
  absl::Status TakeFile(const std::string& path, archive_entry* entry);
  absl::Status MakeFolder(const std::string& path);
  absl::Status CopyContent(const std::string& path, int fd, Entry& file);
  // Opens the folder that holds `path`; creates it and its parents if missing.
  absl::StatusOr<Fd> FolderOf(const std::string& path);

  archive* reader_;
  int root_;
  const ArtefactLimits limits_;
  const std::function<void()> read_;
  Listing listing_;
  int64_t headers_ = 0;
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
  // The top folder may be named any number of times without being listed.
  if (++headers_ > limits_.files + 1) return listing_.TooManyEntries(std::string_view("./"));
  const char* raw = archive_entry_pathname(entry);
  if (raw == nullptr) {
    return absl::InvalidArgumentError("an entry of the archive has no name that is UTF-8");
  }
  ASSIGN_OR_RETURN(std::string path, listing_.CleanPath(raw));
  if (archive_entry_hardlink(entry) != nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(path), " is a hard link; put the file itself there"));
  }
  const mode_t type = archive_entry_filetype(entry);
  if ((archive_entry_perm(entry) & (S_ISUID | S_ISGID)) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(path), " has the setuid or setgid bit; remove it with chmod a-s"));
  }
  if ((archive_entry_perm(entry) & S_ISVTX) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(path), " has the sticky bit; remove it with chmod -t"));
  }
  if (archive_entry_is_encrypted(entry) != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the entry ", Quoted(path), " is encrypted; make the archive without a password"));
  }
  if (type == AE_IFDIR) return path.empty() ? absl::OkStatus() : MakeFolder(path);
  if (path.empty()) {
    return absl::InvalidArgumentError("the archive's top is not a folder");
  }
  if (type == AE_IFREG) return TakeFile(path, entry);
  if (type != AE_IFLNK) {
    return absl::InvalidArgumentError(
        absl::StrCat("the entry ", Quoted(path), " is ", std::string(KindName(type)),
                     "; only files, folders and symbolic links are allowed"));
  }
  const char* target = archive_entry_symlink(entry);
  RETURN_IF_ERROR(CheckLinkTarget(path, target == nullptr ? "" : target));
  ASSIGN_OR_RETURN(Entry* link, listing_.Add(path, EntryType::kLink));
  link->target = target;
  ASSIGN_OR_RETURN(const Fd folder, FolderOf(path));
  if (::symlinkat(target, folder.get(), std::string(BaseName(path)).c_str()) != 0) {
    return HostError(absl::StrCat("can't make the link ", Quoted(path)));
  }
  return absl::OkStatus();
}

absl::Status Unpacker::MakeFolder(const std::string& path) {
  RETURN_IF_ERROR(listing_.Add(path, EntryType::kFolder).status());
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
  ASSIGN_OR_RETURN(Entry* file, listing_.Add(path, EntryType::kFile));
  file->executable = (archive_entry_perm(entry) & 0111) != 0;
  // A claimed size proves nothing, but one above the limit can be rejected at once.
  if (archive_entry_size_is_set(entry) != 0) {
    RETURN_IF_ERROR(listing_.CheckRoom(path, archive_entry_size(entry)));
  }
  ASSIGN_OR_RETURN(const Fd folder, FolderOf(path));
  const Fd fd(::openat(folder.get(), std::string(BaseName(path)).c_str(),
                       O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!fd.valid()) return HostError(absl::StrCat("can't make the file ", Quoted(path)));
  RETURN_IF_ERROR(CopyContent(path, fd.get(), *file));
  // Python uses a compiled module only if its source still has the time recorded in it.
  const timespec time = {KeptTime(archive_entry_mtime(entry)), 0};
  if (const timespec times[] = {time, time}; ::futimens(fd.get(), times) != 0) {
    return HostError(absl::StrCat("can't set the time of ", Quoted(path)));
  }
  if (::fchmod(fd.get(), file->executable ? 0755 : 0644) != 0) {
    return HostError(absl::StrCat("can't set the mode of ", Quoted(path)));
  }
  return absl::OkStatus();
}

absl::Status Unpacker::CopyContent(const std::string& path, int fd, Entry& file) {
  Sha256 hash;
  std::string buffer(64 << 10, '\0');
  for (;;) {
    // Count the bytes as they come: the size in a header proves nothing. The holes of sparse files
    // arrive here as zeros and count too.
    const la_ssize_t got = archive_read_data(reader_, buffer.data(), buffer.size());
    if (got < 0 && HostFailed(reader_)) return HostError("can't read the archive");
    if (got < 0) {
      return absl::InvalidArgumentError(absl::StrCat("the archive is broken in the entry ",
                                                     Quoted(path), ": ", ArchiveReason(reader_)));
    }
    if (got == 0) break;
    RETURN_IF_ERROR(listing_.AddBytes(path, got));
    const std::string_view piece(buffer.data(), static_cast<size_t>(got));
    if (file.size == 0 && piece.starts_with("version https://git-lfs.github.com/spec/")) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the file ", Quoted(path), " is a pointer of Git LFS in place of its content; get that with "
          "\"git lfs pull\" before you pack, or leave the file out"));
    }
    hash.Update(piece);
    for (la_ssize_t done = 0; done < got;) {
      const ssize_t put = ::write(fd, buffer.data() + done, static_cast<size_t>(got - done));
      if (put < 0 && errno == EINTR) continue;
      if (put <= 0) return HostError(absl::StrCat("can't write the file ", Quoted(path)));
      done += put;
    }
    file.size += got;
    read_();
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

// A reader for the documented kinds of archive only: each further parser of libarchive adds attack
// surface.
std::unique_ptr<archive, ArchiveReader> MakeReader(Compression compression) {
  std::unique_ptr<archive, ArchiveReader> reader(archive_read_new());
  SupportCompression(reader.get(), compression);
  archive_read_support_format_tar(reader.get());
  archive_read_support_format_zip(reader.get());
  return reader;
}

bool IsProgram(int file) {
  std::array<char, 4> bytes = {};
  const ssize_t got = ::pread(file, bytes.data(), bytes.size(), 0);
  const std::string_view magic(bytes.data(), static_cast<size_t>(std::max<ssize_t>(got, 0)));
  return magic.starts_with("#!") || magic == "\x7f" "ELF";
}

// Archives from Windows have no modes, or have them for .bat and the like. Where no program can be executed
// and the submission needs one that can, its programs and scripts become executable.
absl::Status AddModes(int folder, Listing& listing) {
  if (ReadSubmittedManifest(folder).ok()) return absl::OkStatus();
  std::vector<std::string> programs;
  for (const auto& [path, entry] : listing.entries()) {
    if (entry.type != EntryType::kFile) continue;
    const Fd file = OpenBeneath(folder, path, O_RDONLY | O_NONBLOCK);
    if (!file.valid() || !IsProgram(file.get())) continue;
    if (entry.executable) return absl::OkStatus();
    programs.push_back(path);
  }
  for (const std::string& path : programs) {
    const Fd file = OpenBeneath(folder, path, O_RDONLY | O_NONBLOCK);
    if (!file.valid() || ::fchmod(file.get(), 0755) != 0) {
      return HostError(absl::StrCat("can't set the mode of ", Quoted(path)));
    }
    listing.MakeExecutable(path);
  }
  return absl::OkStatus();
}

// Unpacks an ordinary submission, which may hold an image's archive as a file.
absl::StatusOr<Listing> UnpackFiles(int archive, int folder, const ArtefactLimits& limits,
                                    const ByteProgress& progress) {
  const Utf8Names utf8_names;
  const Compression compression = CompressionOf(archive);
  const auto reader = MakeReader(compression);
  const auto broken = [&](std::string_view what) {
    if (HostFailed(reader.get())) return HostError("can't read the archive");
    return absl::InvalidArgumentError(
        absl::StrCat(absl::string_view(what.data(), what.size()), ": ", ArchiveReason(reader.get())));
  };
  if (archive_read_open_fd(reader.get(), archive, 64 << 10) != ARCHIVE_OK) {
    return broken("this is no archive of a kind that is accepted (tar, tar.gz, tar.zst, tar.xz, tar.bz2, zip)");
  }
  // One layer besides the file itself: nested bombs multiply.
  if (archive_filter_count(reader.get()) > (compression == Compression::kNone ? 1 : 2)) {
    return absl::InvalidArgumentError("the archive is compressed more than once; once is enough");
  }
  struct stat info = {};
  const int64_t total = progress && ::fstat(archive, &info) == 0 ? info.st_size : 0;
  Unpacker unpacker(reader.get(), folder, limits, [&] {
    // -1: the file's own bytes, below all filters.
    if (progress) progress(archive_filter_bytes(reader.get(), -1), total);
  });
  for (;;) {
    archive_entry* entry = nullptr;
    const int result = archive_read_next_header(reader.get(), &entry);
    if (result == ARCHIVE_EOF) break;
    // Also for ARCHIVE_RETRY: libarchive would continue after a damaged header, and a file would be
    // missing.
    if (result != ARCHIVE_OK && result != ARCHIVE_WARN) {
      return broken(
          "the archive is broken or of a kind that is not accepted (tar, tar.gz, tar.zst, tar.xz, tar.bz2, zip)");
    }
    RETURN_IF_ERROR(unpacker.Take(entry));
  }
  Listing listing = unpacker.listing();
  RETURN_IF_ERROR(AddModes(folder, listing));
  return listing;
}

// Replaces a submission's two files by the image's content. The archive's name is gone first, so
// that nothing of it collides with what is made.
absl::StatusOr<Artefact> UnpackImageFile(const SubmittedManifest& submitted, int folder,
                                         const ArtefactLimits& limits) {
  const Fd file = OpenBeneath(folder, submitted.image_file, O_RDONLY | O_NONBLOCK);
  if (!file.valid()) return HostError("can't open the image's archive");
  for (const std::string& name : {submitted.image_file, std::string("policy.json")}) {
    if (::unlinkat(folder, name.c_str(), 0) != 0) return HostError("can't remove " + name);
  }
  return UnpackImage(file.get(), folder, submitted.json, limits, [] {});
}

}  // namespace

absl::StatusOr<UnpackPlace> OpenUnpackPlace(const std::string& archive,
                                            const std::string& destination) {
  if (::mkdir(destination.c_str(), 0755) != 0) {
    return HostError(absl::StrCat("can't make the folder ", destination));
  }
  UnpackPlace place;
  place.folder = Fd(::open(destination.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  absl::Status status;
  if (!place.folder.valid() || ::fchmod(place.folder.get(), 0755) != 0) {
    status = HostError(absl::StrCat("can't open the folder ", destination));
  } else {
    place.archive = Fd(::open(archive.c_str(), O_RDONLY | O_CLOEXEC));
    if (!place.archive.valid()) {
      status = HostError(absl::StrCat("can't open the archive ", archive));
    }
  }
  if (status.ok()) return place;
  ::rmdir(destination.c_str());
  return status;
}

absl::StatusOr<Artefact> UnpackOpened(int archive, int folder, const ArtefactLimits& limits,
                                      const ByteProgress& progress) {
  RETURN_IF_ERROR(CheckLimits(limits));
  const Utf8Names utf8_names;
  if (IsImageArchive(archive, folder, limits)) {
    return UnpackImage(archive, folder, nlohmann::json::object(), limits, [] {});
  }
  ASSIGN_OR_RETURN(const Listing listing, UnpackFiles(archive, folder, limits, progress));
  ASSIGN_OR_RETURN(SubmittedManifest submitted, ReadSubmittedManifest(folder));
  if (!submitted.image_file.empty()) return UnpackImageFile(submitted, folder, limits);
  return Artefact{.digest = listing.Digest(),
                  .manifest = std::move(submitted.manifest),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

namespace {

// What `unpack` makes of the opened archive and folder; after an error there is no folder.
template <typename Result, typename Unpack>
Result UnpackInto(const std::string& archive, const std::string& destination,
                  const Unpack& unpack) {
  ASSIGN_OR_RETURN(const UnpackPlace place, OpenUnpackPlace(archive, destination));
  Result result = unpack(place.archive.get(), place.folder.get());
  if (!result.ok()) {
    std::error_code ignored;  // the first error is the one to report
    std::filesystem::remove_all(destination, ignored);
  }
  return result;
}

}  // namespace

absl::StatusOr<Artefact> UnpackArtefact(const std::string& archive, const std::string& destination,
                                        const ArtefactLimits& limits,
                                        const ByteProgress& progress) {
  return UnpackInto<absl::StatusOr<Artefact>>(archive, destination, [&](int file, int folder) {
    return UnpackOpened(file, folder, limits, progress);
  });
}

absl::Status UnpackSubmission(const std::string& archive, const std::string& destination,
                              const ArtefactLimits& limits, const ByteProgress& progress) {
  RETURN_IF_ERROR(CheckLimits(limits));
  return UnpackInto<absl::Status>(archive, destination, [&](int file, int folder) {
    return UnpackFiles(file, folder, limits, progress).status();
  });
}

}  // namespace myograde::server
