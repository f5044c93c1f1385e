#include "server/artefact/artefact.h"

#include <archive_entry.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <set>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/listing.h"
#include "server/artefact/submission.h"

namespace myograde::server {
namespace {

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
    return "is encrypted; create the archive without a password";
  }
  const mode_t type = archive_entry_filetype(entry);
  if (type == AE_IFDIR || type == AE_IFREG || type == AE_IFLNK) return "";
  const std::string kind = type == AE_IFBLK || type == AE_IFCHR ? "a device node"
                           : type == AE_IFIFO                   ? "a named pipe"
                           : type == AE_IFSOCK                  ? "a socket"
                                                                : "of an unknown kind";
  return absl::StrCat("is ", kind, "; only files, folders and symbolic links are allowed");
}

constexpr char kBroken[] =
    "the archive is broken or of an unsupported kind (tar, tar.gz, tar.zst, tar.xz, "
    "tar.bz2, zip)";

// Makes the files of an archive's entries, which a participant chose, in a folder.
class Unpacker {
 public:
  // Into the empty folder `root`. `whose`: whose archive it is, which is open. `read` is called
  // after each block.
  Unpacker(StreamArchive& archive, int root, const ArtefactLimits& limits, FolderOf whose,
           std::function<void()> read)
      : archive_(archive),
        root_(root),
        limits_(limits),
        submitted_(whose == FolderOf::kParticipant),
        read_(std::move(read)),
        listing_(limits) {}

  // Unpacks all entries. InvalidArgumentError: the archive is broken, or breaks a rule of
  // submissions; one of the daemon's is not judged by those that no path depends on. Other codes: a
  // problem of this host.
  absl::Status UnpackAll() {
    for (;;) {
      archive_entry* entry = nullptr;
      ASSIGN_OR_RETURN(const bool found, archive_.NextEntry(&entry, kBroken));
      if (!found) return absl::OkStatus();
      RETURN_IF_ERROR(Take(entry));
    }
  }

  const Listing& listing() const { return listing_; }

 private:
  absl::Status Take(archive_entry* entry) {
    // The top folder may be named any number of times without being listed.
    if (++headers_ > limits_.files + 1) return listing_.TooManyEntries(std::string_view("./"));
    const char* raw = archive_entry_pathname(entry);
    if (raw == nullptr) {
      return absl::InvalidArgumentError("an entry of the archive has a name that is not UTF-8");
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
      return MakeParents(path + "/");
    }
    const char* text = archive_entry_symlink(entry);
    const std::string target = text == nullptr ? "" : text;
    // An image's links lead where they like.
    RETURN_IF_ERROR(submitted_ ? CheckLinkTarget(path, target) : CheckLinkText(path, target));
    ASSIGN_OR_RETURN(Entry* const link, listing_.Add(path, EntryType::kLink));
    link->target = target;
    RETURN_IF_ERROR(MakeParents(path));
    return MakeLinkBeneath(root_, path, target);
  }

  absl::Status TakeFile(const std::string& path, archive_entry* entry) {
    ASSIGN_OR_RETURN(Entry* const file, listing_.Add(path, EntryType::kFile));
    file->executable = (archive_entry_perm(entry) & 0111) != 0;
    // Python uses a compiled module only if its source still has the time recorded in it.
    file->time = KeptTime(archive_entry_mtime(entry));
    // A claimed size proves nothing, but one above the limit can be rejected at once.
    if (archive_entry_size_is_set(entry) != 0) {
      RETURN_IF_ERROR(listing_.CheckRoom(path, archive_entry_size(entry)));
    }
    RETURN_IF_ERROR(MakeParents(path));
    const std::string broken = absl::StrCat("the archive is broken in the entry ", Quoted(path));
    return MakeFileBeneath(root_, path, *file, [&]() -> absl::StatusOr<std::string_view> {
      if (file->size > 0) read_();
      // Count the bytes as they come: the size in a header proves nothing. The holes of sparse
      // files arrive here as zeros and count too.
      ASSIGN_OR_RETURN(const std::string_view piece, archive_.NextData(broken));
      RETURN_IF_ERROR(listing_.AddBytes(path, std::ssize(piece)));
      if (submitted_ && file->size == 0 &&
          piece.starts_with("version https://git-lfs.github.com/spec/")) {
        return absl::InvalidArgumentError(absl::StrCat(
            "the file ", Quoted(path),
            " is a Git LFS pointer instead of its content; run \"git lfs pull\" before you pack, "
            "or leave the file out"));
      }
      return piece;
    });
  }

  // Makes the folders above `path` that are missing.
  absl::Status MakeParents(const std::string& path) {
    for (size_t slash = path.find('/'); slash != std::string::npos;
         slash = path.find('/', slash + 1)) {
      const std::string folder = path.substr(0, slash);
      if (made_.insert(folder).second) RETURN_IF_ERROR(MakeFolderBeneath(root_, folder));
    }
    return absl::OkStatus();
  }

  StreamArchive& archive_;
  const int root_;
  const ArtefactLimits limits_;
  const bool submitted_;
  const std::function<void()> read_;
  Listing listing_;
  int64_t headers_ = 0;
  std::set<std::string> made_;  // folders
};

// Archives from Windows have no modes, or have them for .bat and the like. Where no program can be executed
// and the submission needs one that can, its programs and scripts become executable.
absl::Status AddModes(int folder, Listing& listing) {
  if (ReadSubmittedManifest(folder).ok()) return absl::OkStatus();
  std::vector<std::string> programs;
  for (const auto& [path, entry] : listing.entries()) {
    if (entry.type != EntryType::kFile) continue;
    const Fd file = OpenBeneath(folder, path, O_RDONLY | O_NONBLOCK);
    if (!file.valid() || ReadProgramHead(file.get()).kind == ProgramHead::Kind::kText) continue;
    if (entry.executable) return absl::OkStatus();
    programs.push_back(path);
  }
  for (const std::string& path : programs) {
    const Fd file = OpenBeneath(folder, path, O_RDONLY | O_NONBLOCK);
    if (!file.valid() || ::fchmod(file.get(), 0755) != 0) {
      return HostError(absl::StrCat("can't set the mode of ", Quoted(path)));
    }
    listing.at(path).executable = true;
  }
  return absl::OkStatus();
}

// Unpacks an ordinary submission, which may hold an image's archive as a file.
absl::StatusOr<Listing> UnpackFiles(int file, int folder, const ArtefactLimits& limits,
                                    const ByteProgress& progress) {
  const Utf8Names utf8_names;
  FileStream bytes(file);
  StreamArchive archive(bytes, StreamArchive::Form::kSubmission);
  RETURN_IF_ERROR(archive.Open("this is not an archive of a supported kind (tar, tar.gz, "
                               "tar.zst, tar.xz, tar.bz2, zip)"));
  // One layer besides the file itself: nested bombs multiply.
  if (archive.compressions() > (IsCompressed(file) ? 1 : 0)) {
    return absl::InvalidArgumentError("the archive is compressed more than once; compress it only "
                                      "once");
  }
  struct stat info = {};
  const int64_t total = ::fstat(file, &info) == 0 ? info.st_size : 0;
  Unpacker unpacker(archive, folder, limits, FolderOf::kParticipant, [&] {
    if (progress) progress(archive.bytes_read(), total);
  });
  RETURN_IF_ERROR(unpacker.UnpackAll());
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
  return UnpackImage(file.get(), folder, submitted.json, limits);
}

// The archive's bytes as they come.
class SourceStream : public ByteStream {
 public:
  explicit SourceStream(const ByteSource& source) : source_(source) {}
  absl::StatusOr<std::string_view> Next() override {
    ASSIGN_OR_RETURN(piece_, source_());
    return piece_;
  }

 private:
  const ByteSource& source_;
  std::string piece_;
};

absl::Status UnpackStream(const ByteSource& source, const std::string& digest, int root) {
  const Utf8Names utf8_names;
  SourceStream bytes(source);
  StreamArchive archive(bytes, StreamArchive::Form::kSent);
  Unpacker unpacker(archive, root, kNoLimits, FolderOf::kDaemon, [] {});
  absl::Status status = archive.Open();
  if (status.ok()) status = unpacker.UnpackAll();
  RETURN_IF_ERROR(archive.failure());
  if (absl::IsInvalidArgument(status)) {
    return absl::DataLossError(absl::StrCat("the packed submission is broken: ", status.message()));
  }
  RETURN_IF_ERROR(status);
  const std::string found = unpacker.listing().Digest();
  if (found == digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the packed submission has files with the digest ", found,
                                          ", not ", digest));
}

// `result`, and after an error no `folder`.
template <typename Result>
Result OrRemoved(Result result, const std::string& folder) {
  std::error_code ignored;  // the first error is the one to report
  if (!result.ok()) std::filesystem::remove_all(folder, ignored);
  return result;
}

}  // namespace

absl::StatusOr<UnpackPlace> OpenUnpackPlace(const std::string& archive,
                                            const std::string& destination) {
  UnpackPlace place;
  place.archive = Fd(::open(archive.c_str(), O_RDONLY | O_CLOEXEC));
  if (!place.archive.valid()) return HostError(absl::StrCat("can't open the archive ", archive));
  ASSIGN_OR_RETURN(place.folder, MakeFolderToFill(destination));
  return place;
}

absl::StatusOr<Artefact> UnpackOpened(int archive, int folder, const ArtefactLimits& limits,
                                      const ByteProgress& progress) {
  const Utf8Names utf8_names;
  if (IsImageArchive(archive, folder, limits)) {
    return UnpackImage(archive, folder, nlohmann::json::object(), limits);
  }
  ASSIGN_OR_RETURN(const Listing listing, UnpackFiles(archive, folder, limits, progress));
  ASSIGN_OR_RETURN(SubmittedManifest submitted, ReadSubmittedManifest(folder));
  if (!submitted.image_file.empty()) return UnpackImageFile(submitted, folder, limits);
  return Artefact{.digest = listing.Digest(),
                  .manifest = std::move(submitted.manifest),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

absl::StatusOr<Artefact> UnpackArtefact(const std::string& archive, const std::string& destination,
                                        const ArtefactLimits& limits,
                                        const ByteProgress& progress) {
  ASSIGN_OR_RETURN(const UnpackPlace place, OpenUnpackPlace(archive, destination));
  return OrRemoved(UnpackOpened(place.archive.get(), place.folder.get(), limits, progress),
                   destination);
}

absl::Status UnpackSubmission(const std::string& archive, const std::string& destination,
                              const ArtefactLimits& limits, const ByteProgress& progress) {
  ASSIGN_OR_RETURN(const UnpackPlace place, OpenUnpackPlace(archive, destination));
  return OrRemoved(UnpackFiles(place.archive.get(), place.folder.get(), limits, progress).status(),
                   destination);
}

absl::Status PlaceStreamedArtefact(const ByteSource& source, const std::string& digest,
                                   const std::string& folder) {
  ASSIGN_OR_RETURN(const Fd root, MakeFolderToFill(folder));
  return OrRemoved(UnpackStream(source, digest, root.get()), folder);
}

}  // namespace myograde::server
