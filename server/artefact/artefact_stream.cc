#include "server/artefact/artefact_stream.h"

#include <archive.h>
#include <fcntl.h>

#include <climits>
#include <filesystem>
#include <memory>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"
#include "server/artefact/listing.h"
#include "server/artefact/tar_writer.h"
#include "server/artefact/unpacker.h"

namespace myograde::server {
namespace {

// What the daemon has accepted is not judged again; the depth alone is bounded, by what it can have
// accepted, as folders are walked by recursion. (An image's files are one folder deeper.)
constexpr ArtefactLimits kNoLimits = {
    .bytes = int64_t{1} << 60, .files = int64_t{1} << 40, .depth = 200, .name_bytes = NAME_MAX};

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

absl::Status UnpackStream(const ByteSource& source, const std::string& digest, int root) {
  const Utf8Names utf8_names;
  TarPieces pieces = {source};
  const std::unique_ptr<archive, ArchiveReader> reader(archive_read_new());
  archive_read_support_format_tar(reader.get());
  if (archive_read_open(reader.get(), &pieces, nullptr, TarPieces::Read, nullptr) != ARCHIVE_OK) {
    return pieces.status.ok() ? absl::DataLossError("the packed submission is no tar")
                              : pieces.status;
  }
  Unpacker unpacker(reader.get(), root, kNoLimits, FolderOf::kDaemon, [] {});
  const absl::Status status = unpacker.UnpackAll();
  RETURN_IF_ERROR(pieces.status);
  if (absl::IsInvalidArgument(status)) {
    return absl::DataLossError(absl::StrCat("the packed submission is broken: ", status.message()));
  }
  RETURN_IF_ERROR(status);
  const std::string found = unpacker.listing().Digest();
  if (found == digest) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("the packed submission holds files of digest ", found,
                                          ", and is to be ", digest));
}

}  // namespace

absl::Status StreamArtefact(const std::string& folder, const std::string& digest,
                            const ByteSink& sink) {
  const Utf8Names utf8_names;
  const Fd root(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!root.valid()) return HostError(absl::StrCat("can't open the submission's folder ", folder));
  Listing listing(kNoLimits);
  RETURN_IF_ERROR(ListFolder(root.get(), FolderOf::kDaemon, listing));
  TarWriter tar(sink);
  for (const auto& [path, entry] : listing.entries()) {
    RETURN_IF_ERROR(tar.Begin(path, entry));
    if (entry.type == EntryType::kFile) {
      const Fd file = OpenBeneath(root.get(), path, O_RDONLY | O_NONBLOCK);
      if (!file.valid()) return Unreadable(path, FolderOf::kDaemon);
      Sha256 hash;
      RETURN_IF_ERROR(tar.Copy(file.get(), path, entry.size, FolderOf::kDaemon,
                               [&](std::string_view piece) { hash.Update(piece); }));
      listing.SetSha256(path, hash.FinishHex());
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
  ASSIGN_OR_RETURN(const Fd root, MakeFolderToFill(folder));
  const absl::Status status = UnpackStream(source, digest, root.get());
  if (status.ok()) return status;
  std::error_code ignored;
  std::filesystem::remove_all(folder, ignored);
  return status;
}

}  // namespace myograde::server
