#include "server/artefact/artefact_stream.h"

#include <archive.h>
#include <archive_entry.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"
#include "server/artefact/folder_lister.h"
#include "server/artefact/listing.h"
#include "server/artefact/tar_writer.h"

namespace myograde::server {
namespace {

constexpr size_t kTarPieceBytes = 256u << 10;

// What the daemon has accepted is not judged again; the depth alone is bounded, by what it can have
// accepted, as folders are walked by recursion. (An image's files are one folder deeper.)
ArtefactLimits NoLimits() {
  constexpr int64_t kMost = std::numeric_limits<int64_t>::max();
  return {.bytes = kMost, .files = kMost, .depth = 200, .name_bytes = NAME_MAX};
}

std::string BaseName(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

std::string FolderName(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : path.substr(0, slash);
}

absl::Status Damaged(const std::string& path, std::string_view what) {
  return absl::DataLossError(absl::StrCat("the submission's ", Quoted(path), " ",
                                          absl::string_view(what.data(), what.size())));
}

// Gives a file's content to the tar, and notes its digest.
absl::Status CopyFile(int root, const std::string& path, const Entry& entry, TarWriter& tar,
                      Listing& listing) {
  const Fd fd = OpenBeneath(root, path, O_RDONLY | O_NONBLOCK);
  struct stat info = {};
  if (!fd.valid() || ::fstat(fd.get(), &info) != 0) {
    return HostError(absl::StrCat("can't open ", Quoted(path)));
  }
  if (!S_ISREG(info.st_mode)) return Damaged(path, "is no file any more");
  Sha256 hash;
  std::string piece(kTarPieceBytes, '\0');
  int64_t left = entry.size;
  for (;;) {
    const ssize_t n = ::read(fd.get(), piece.data(), piece.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return HostError(absl::StrCat("can't read ", Quoted(path)));
    if (n > left || (n == 0 && left > 0)) return Damaged(path, "changed while it was packed");
    if (n == 0) break;
    left -= n;
    const std::string_view bytes(piece.data(), static_cast<size_t>(n));
    hash.Update(bytes);
    RETURN_IF_ERROR(tar.Write(bytes));
  }
  listing.SetSha256(path, hash.FinishHex());
  return absl::OkStatus();
}

// Makes a folder's content from the archive's entries.
class Unpacker {
 public:
  Unpacker(archive* reader, int root) : reader_(reader), root_(root), listing_(NoLimits()) {}

  absl::StatusOr<std::string> Unpack() {
    for (;;) {
      archive_entry* entry = nullptr;
      const int result = archive_read_next_header(reader_, &entry);
      if (result == ARCHIVE_EOF) return listing_.Digest();
      if (result != ARCHIVE_OK) return Broken();
      RETURN_IF_ERROR(Take(entry));
    }
  }

 private:
  absl::Status Broken() const {
    const char* why = archive_error_string(reader_);
    return absl::DataLossError(absl::StrCat("the packed submission is broken: ",
                                            why != nullptr ? why : "no reason given"));
  }

  absl::Status Take(archive_entry* entry) {
    const char* raw = archive_entry_pathname(entry);
    if (raw == nullptr || archive_entry_hardlink(entry) != nullptr) return Broken();
    ASSIGN_OR_RETURN(const std::string path, listing_.CleanPath(raw));
    const Fd folder = OpenBeneath(root_, FolderName(path), O_PATH | O_DIRECTORY);
    if (!folder.valid()) return HostError(absl::StrCat("can't open the folder of ", Quoted(path)));
    const std::string base = BaseName(path);
    switch (archive_entry_filetype(entry)) {
      case AE_IFDIR: return TakeFolder(folder.get(), path, base);
      case AE_IFLNK: return TakeLink(folder.get(), path, base, archive_entry_symlink(entry));
      case AE_IFREG: return TakeFile(folder.get(), path, base, entry);
      default: return Damaged(path, "is no file, folder or symbolic link");
    }
  }

  absl::Status TakeFolder(int folder, const std::string& path, const std::string& base) {
    if (const auto entry = listing_.Add(path, EntryType::kFolder); !entry.ok()) {
      return entry.status();
    }
    if (::mkdirat(folder, base.c_str(), 0755) != 0 ||
        ::fchmodat(folder, base.c_str(), 0755, 0) != 0) {
      return HostError(absl::StrCat("can't make the folder ", Quoted(path)));
    }
    return absl::OkStatus();
  }

  absl::Status TakeLink(int folder, const std::string& path, const std::string& base,
                        const char* target) {
    ASSIGN_OR_RETURN(Entry* const entry, listing_.Add(path, EntryType::kLink));
    if (target == nullptr) return Damaged(path, "is a link without a target");
    entry->target = target;
    if (::symlinkat(target, folder, base.c_str()) != 0) {
      return HostError(absl::StrCat("can't make the link ", Quoted(path)));
    }
    return absl::OkStatus();
  }

  absl::Status TakeFile(int folder, const std::string& path, const std::string& base,
                        archive_entry* about) {
    ASSIGN_OR_RETURN(Entry* const entry, listing_.Add(path, EntryType::kFile));
    entry->executable = (archive_entry_perm(about) & 0111) != 0;
    const Fd file(::openat(folder, base.c_str(),
                           O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
    if (!file.valid()) return HostError(absl::StrCat("can't make the file ", Quoted(path)));
    RETURN_IF_ERROR(Copy(file.get(), path, *entry));
    const timespec time = {KeptTime(archive_entry_mtime(about)), 0};
    const timespec times[] = {time, time};
    if (::futimens(file.get(), times) != 0 ||
        ::fchmod(file.get(), entry->executable ? 0755 : 0644) != 0) {
      return HostError(absl::StrCat("can't set mode and time of ", Quoted(path)));
    }
    return absl::OkStatus();
  }

  absl::Status Copy(int file, const std::string& path, Entry& entry) {
    Sha256 hash;
    for (;;) {
      const la_ssize_t got = archive_read_data(reader_, piece_.data(), piece_.size());
      if (got < 0) return Broken();
      if (got == 0) break;
      hash.Update(std::string_view(piece_.data(), static_cast<size_t>(got)));
      entry.size += got;
      for (la_ssize_t done = 0; done < got;) {
        const ssize_t n =
            ::write(file, piece_.data() + done, static_cast<size_t>(got - done));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return HostError(absl::StrCat("can't write ", Quoted(path)));
        done += n;
      }
    }
    entry.sha256 = hash.FinishHex();
    return absl::OkStatus();
  }

  archive* const reader_;
  const int root_;
  Listing listing_;
  std::string piece_ = std::string(kTarPieceBytes, '\0');
};

// The archive's bytes as they come.
struct TarPieces {
  const ByteSource& source;
  std::string piece = {};
  absl::Status status = {};

  static la_ssize_t Read(archive*, void* self, const void** data) {
    auto& pieces = *static_cast<TarPieces*>(self);
    absl::StatusOr<std::string> piece = pieces.source();
    pieces.status = piece.status();
    if (!piece.ok()) return -1;
    pieces.piece = *std::move(piece);
    *data = pieces.piece.data();
    return std::ssize(pieces.piece);
  }
};

absl::Status UnpackInto(const ByteSource& source, const std::string& digest, int root) {
  const Utf8Names utf8_names;
  TarPieces pieces = {source};
  const std::unique_ptr<archive, ArchiveReader> reader(archive_read_new());
  archive_read_support_format_tar(reader.get());
  if (archive_read_open(reader.get(), &pieces, nullptr, TarPieces::Read, nullptr) != ARCHIVE_OK) {
    return pieces.status.ok() ? absl::DataLossError("the packed submission is no tar")
                              : pieces.status;
  }
  const absl::StatusOr<std::string> found = Unpacker(reader.get(), root).Unpack();
  RETURN_IF_ERROR(pieces.status);
  if (!found.ok()) return found.status();
  if (*found == digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the packed submission holds files of digest ", *found,
                                          ", and is to be ", digest));
}

}  // namespace

absl::Status StreamArtefact(const std::string& folder, const std::string& digest,
                            const ByteSink& sink) {
  const Utf8Names utf8_names;
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!root.valid()) return HostError(absl::StrCat("can't open the submission's folder ", folder));
  Listing listing(NoLimits());
  RETURN_IF_ERROR(ListFolder(root.get(), FolderOf::kDaemon, listing));
  TarWriter tar(sink);
  for (const auto& [path, entry] : listing.entries()) {
    RETURN_IF_ERROR(tar.Begin(path, entry));
    if (entry.type == EntryType::kFile) {
      RETURN_IF_ERROR(CopyFile(root.get(), path, entry, tar, listing));
    }
  }
  RETURN_IF_ERROR(tar.Close());
  if (listing.Digest() == digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(
      "the submission's folder ", folder, " holds files of digest ", listing.Digest(),
      ", and should hold ", digest, "; restore it from a backup, or have it submitted again"));
}

absl::Status PlaceStreamedArtefact(const ByteSource& source, const std::string& digest,
                                   const std::string& folder) {
  if (::mkdir(folder.c_str(), 0755) != 0) {
    return HostError(absl::StrCat("can't make the folder ", folder));
  }
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  absl::Status status = root.valid() && ::fchmod(root.get(), 0755) == 0
                            ? UnpackInto(source, digest, root.get())
                            : HostError(absl::StrCat("can't open ", folder));
  if (status.ok()) return status;
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return status;
}

}  // namespace myograde::server
