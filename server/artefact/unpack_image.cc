#include "server/artefact/unpack_image.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/image_tree.h"
#include "server/artefact/listing.h"
#include "server/artefact/saved_name.h"
#include "server/artefact/submitted_manifest.h"

namespace myograde::server {
namespace {

// What a layer's headers take beside its files: an entry's own with a long name, and padding.
constexpr int64_t kHeaderBytes = 4096;
constexpr int64_t kPaddingBytes = 8 << 20;
constexpr char kDecompressed[] = ".decompressed";

// All bytes that the image's layers and archive may yield, decompressed.
int64_t StreamLimit(const ArtefactLimits& limits) {
  return limits.bytes + 2 * limits.files * kHeaderBytes + kPaddingBytes;
}

absl::Status About(std::string_view what, const absl::Status& status) {
  if (!absl::IsInvalidArgument(status)) return status;
  return absl::InvalidArgumentError(
      absl::StrCat(absl::string_view(what.data(), what.size()), ": ", status.message()));
}

// The archive itself, decompressed into a file of `folder` that has no name, if it is compressed:
// what it holds is read in another order.
absl::StatusOr<Fd> Decompressed(int file, int folder, int64_t limit) {
  Fd plain(::openat(folder, kDecompressed, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!plain.valid() || ::unlinkat(folder, kDecompressed, 0) != 0) {
    return HostError("can't make a file for the decompressed image");
  }
  FileStream bytes(file);
  DecompressedStream stream(bytes);
  CheckedStream counted(stream, "it", limit);
  for (;;) {
    const absl::StatusOr<std::string_view> piece = counted.Next();
    if (!piece.ok()) return About("the compressed image", piece.status());
    if (piece->empty()) return plain;
    if (!WriteAll(plain.get(), *piece).ok()) return HostError("can't write the decompressed image");
  }
}

absl::Status CheckLayer(const CheckedStream& packed, const CheckedStream& tar,
                        const ImageLayer& layer) {
  if (layer.size >= 0 && packed.size() != layer.size) {
    return absl::InvalidArgumentError(absl::StrCat("has ", packed.size(), " bytes where its archive "
                                                   "states ", layer.size, "; save the image again"));
  }
  if (!layer.sha256.empty() && packed.sha256() != layer.sha256) {
    return absl::InvalidArgumentError(
        "has another digest than its archive states; save the image again");
  }
  if (tar.sha256() != layer.diff_id) {
    return absl::InvalidArgumentError(
        "has another content than the image's config states (diff_ids); save the image again");
  }
  return absl::OkStatus();
}

// Adds one layer, which is decompressed and hashed on its way.
// `place`: "2 of 5".
absl::Status AddLayer(const ImageArchive& archive, const ImageLayer& layer,
                      const std::string& place, int64_t& left, ImageTree& tree) {
  const std::unique_ptr<MemberStream> member = archive.Open(layer.member);
  int64_t packed_left = archive.SizeOf(layer.member);
  CheckedStream packed(*member, "it", packed_left);
  DecompressedStream decompressed(packed);
  CheckedStream tar(decompressed, "it", left);
  StreamArchive entries(tar, StreamArchive::Form::kTar);
  absl::Status status = entries.Open();
  if (status.ok()) status = tree.AddLayer(entries);
  if (status.ok()) status = tar.Finish();
  if (status.ok()) status = packed.Finish();
  if (status.ok()) status = CheckLayer(packed, tar, layer);
  return About(absl::StrCat("the image's layer ", place), status);
}

// Writes the policy.json of the artefact and adds it to the listing.
absl::Status WriteManifest(int folder, const std::string& text, Listing& listing) {
  ASSIGN_OR_RETURN(Entry* const entry, listing.Add("policy.json", EntryType::kFile));
  const auto size = static_cast<int64_t>(text.size());
  RETURN_IF_ERROR(listing.AddBytes("policy.json", size));
  entry->size = size;
  entry->sha256 = Sha256Hex(text);
  const Fd file(::openat(folder, "policy.json",
                         O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  const timespec times[] = {{0, 0}, {0, 0}};
  if (!file.valid() || !WriteAll(file.get(), text).ok() || ::futimens(file.get(), times) != 0 ||
      ::fchmod(file.get(), 0644) != 0) {
    return HostError("can't write policy.json");
  }
  return absl::OkStatus();
}

absl::StatusOr<Fd> MakeTreeFolder(int folder) {
  if (::mkdirat(folder, kImageFolder, 0755) != 0 ||
      ::fchmodat(folder, kImageFolder, 0755, 0) != 0) {
    return HostError("can't make the image's folder");
  }
  Fd opened(::openat(folder, kImageFolder, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC));
  if (!opened.valid()) return HostError("can't open the image's folder");
  return opened;
}

absl::StatusOr<Artefact> FromContent(const ImageArchive& archive, ImageContent content, int folder,
                                     nlohmann::json manifest, const ArtefactLimits& limits,
                                     const std::function<void()>& read) {
  ASSIGN_OR_RETURN(const Fd root, MakeTreeFolder(folder));
  ImageTree tree(root.get(), limits);
  int64_t left = StreamLimit(limits);
  for (size_t i = 0; i < content.layers.size(); ++i) {
    const std::string place = absl::StrCat(i + 1, " of ", content.layers.size());
    RETURN_IF_ERROR(AddLayer(archive, content.layers[i], place, left, tree));
    read();
  }
  PolicyImage& image = content.config.image;
  RETURN_IF_ERROR(tree.Finish(content.config.user, image));
  if (!manifest.contains("name")) {
    manifest["name"] = content.tag.empty() ? "image" : NameOfTag(content.tag);
  }
  if (!manifest.contains("command")) manifest["command"] = content.config.command;
  if (manifest["command"].empty()) {
    return absl::InvalidArgumentError("the image has neither ENTRYPOINT nor CMD; build it with one, "
                                      "or give a \"command\" in policy.json");
  }
  manifest.erase("image");
  ASSIGN_OR_RETURN(ArtefactManifest parsed, ParseManifest(manifest));
  parsed.image = image;
  manifest["image"] = PolicyImageToJson(image);
  Listing listing(limits);
  absl::Status listed = tree.ListIn(listing);
  if (listed.ok()) listed = WriteManifest(folder, CanonicalJson(manifest) + "\n", listing);
  if (!listed.ok()) return listed;
  return Artefact{.digest = listing.Digest(),
                  .manifest = std::move(parsed),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

}  // namespace

bool IsImageArchive(int file, int folder, const ArtefactLimits& limits) {
  if (!ImageArchive::MayBe(file)) return false;
  Fd plain;
  if (IsCompressed(file)) {
    absl::StatusOr<Fd> made = Decompressed(file, folder, StreamLimit(limits));
    if (!made.ok()) return false;
    plain = *std::move(made);
  }
  const absl::StatusOr<ImageArchive> archive =
      ImageArchive::Index(plain.valid() ? plain.get() : file);
  return archive.ok() && archive->IsImage();
}

bool MayBeImageArchive(int file) {
  if (!ImageArchive::MayBe(file) || IsCompressed(file)) return ImageArchive::MayBe(file);
  const absl::StatusOr<ImageArchive> archive = ImageArchive::Index(file);
  return archive.ok() && archive->IsImage();
}

absl::StatusOr<Artefact> UnpackImage(int file, int folder, nlohmann::json manifest,
                                     const ArtefactLimits& limits,
                                     const std::function<void()>& read) {
  Fd plain;
  if (IsCompressed(file)) {
    ASSIGN_OR_RETURN(plain, Decompressed(file, folder, StreamLimit(limits)));
  }
  const absl::StatusOr<ImageArchive> archive =
      ImageArchive::Index(plain.valid() ? plain.get() : file);
  if (!archive.ok()) return About("the image", archive.status());
  if (!archive->IsImage()) {
    return absl::InvalidArgumentError(
        "the image is not in a form that is accepted: write it with podman save, docker save or "
        "buildah push IMAGE oci-archive:FILE.tar");
  }
  ASSIGN_OR_RETURN(ImageContent content, archive->Read());
  return FromContent(*archive, std::move(content), folder, std::move(manifest), limits, read);
}

}  // namespace myograde::server
