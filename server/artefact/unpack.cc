#include <archive.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <vector>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/program_head.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/artefact.h"
#include "server/artefact/beneath.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/image_submission.h"
#include "server/artefact/listing.h"
#include "server/artefact/submitted_manifest.h"
#include "server/artefact/unpacker.h"

namespace myograde::server {
namespace {

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
  struct stat info = {};
  const int64_t total = progress && ::fstat(archive, &info) == 0 ? info.st_size : 0;
  Unpacker unpacker(reader.get(), folder, limits, FolderOf::kParticipant, [&] {
    // -1: the file's own bytes, below all filters.
    if (progress) progress(archive_filter_bytes(reader.get(), -1), total);
  });
  if (archive_read_open_fd(reader.get(), archive, 64 << 10) != ARCHIVE_OK) {
    return unpacker.Failure(
        "this is no archive of a kind that is accepted (tar, tar.gz, tar.zst, tar.xz, tar.bz2, "
        "zip)");
  }
  // One layer besides the file itself: nested bombs multiply.
  if (archive_filter_count(reader.get()) > (compression == Compression::kNone ? 1 : 2)) {
    return absl::InvalidArgumentError("the archive is compressed more than once; once is enough");
  }
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
  RETURN_IF_ERROR(CheckLimits(limits));
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
