#include "server/artefact/submission.h"

#include <archive_entry.h>
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/beneath.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/image_tree.h"
#include "server/artefact/listing.h"
#include "server/base/plain_text.h"

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

absl::Status About(absl::string_view what, const absl::Status& status) {
  if (!absl::IsInvalidArgument(status)) return status;
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", status.message()));
}

// The archive itself, decompressed into a file of `folder` that has no name, if it is compressed:
// what it holds is read in another order.
absl::StatusOr<Fd> Decompressed(int file, int folder, int64_t limit) {
  Fd plain(::openat(folder, kDecompressed, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!plain.valid() || ::unlinkat(folder, kDecompressed, 0) != 0) {
    return HostError("can't make a file for the decompressed image");
  }
  FileStream bytes(file);
  EntryStream stream(bytes);
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

// Adds one layer, which is decompressed and hashed on its way. `place`: "2 of 5".
absl::Status AddLayer(const ImageArchive& archive, const ImageLayer& layer,
                      const std::string& place, int64_t& left, ImageTree& tree) {
  MemberStream member = archive.Open(layer.member);
  int64_t packed_left = archive.SizeOf(layer.member);
  CheckedStream packed(member, "it", packed_left);
  EntryStream decompressed(packed);
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
  RETURN_IF_ERROR(listing.AddBytes("policy.json", std::ssize(text)));
  std::string_view left = text;
  return MakeFileBeneath(folder, "policy.json", *entry,
                         [&] { return std::exchange(left, std::string_view()); });
}

absl::StatusOr<Artefact> FromContent(const ImageArchive& archive, ImageContent content, int folder,
                                     nlohmann::json manifest, const ArtefactLimits& limits) {
  RETURN_IF_ERROR(MakeFolderBeneath(folder, kImageFolder));
  const Fd root = OpenBeneath(folder, kImageFolder, O_RDONLY | O_DIRECTORY);
  if (!root.valid()) return HostError("can't open the image's folder");
  ImageTree tree(root.get(), limits);
  int64_t left = StreamLimit(limits);
  for (size_t i = 0; i < content.layers.size(); ++i) {
    const std::string place = absl::StrCat(i + 1, " of ", content.layers.size());
    RETURN_IF_ERROR(AddLayer(archive, content.layers[i], place, left, tree));
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
  RETURN_IF_ERROR(tree.ListIn(listing));
  RETURN_IF_ERROR(WriteManifest(folder, CanonicalJson(manifest) + "\n", listing));
  return Artefact{.digest = listing.Digest(),
                  .manifest = std::move(parsed),
                  .bytes = listing.bytes(),
                  .files = static_cast<int64_t>(listing.entries().size())};
}

constexpr std::array kNaming = {"index.json", "manifest.json", "oci-layout"};

// The text of an entry; "" if it is too long or can't be read.
std::string TextOfEntry(StreamArchive& archive) {
  std::string text;
  for (;;) {
    const absl::StatusOr<std::string_view> piece = archive.NextData();
    if (!piece.ok() || std::ssize(text) > kMaxImageJson) return "";
    if (piece->empty()) return text;
    text += *piece;
  }
}

nlohmann::json ParsedOrNull(const std::string& text) {
  nlohmann::json json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  return json.is_discarded() ? nlohmann::json() : json;
}

// The tag by the members that name an image; which one counts is as in ImageArchive::Read.
std::string TagIn(ByteStream& bytes) {
  StreamArchive archive(bytes, StreamArchive::Form::kTar);
  std::map<std::string, std::string> texts;
  if (!archive.Open().ok()) return "";
  archive_entry* entry = nullptr;
  while (texts.size() < kNaming.size()) {
    const absl::StatusOr<bool> found = archive.NextEntry(&entry);
    if (!found.ok() || !*found) break;
    const char* raw = archive_entry_pathname(entry);
    const std::string name = raw == nullptr ? "" : PlainMemberName(raw);
    for (const char* known : kNaming) {
      if (name == known) texts.emplace(name, TextOfEntry(archive));
    }
  }
  if (texts.contains("oci-layout") && texts.contains("index.json")) {
    return TagOfIndex(ParsedOrNull(texts["index.json"]));
  }
  return TagOfDockerManifest(ParsedOrNull(texts["manifest.json"]));
}

// An image's archive that may have had to be decompressed.
struct OpenedImage {
  Fd plain;
  ImageArchive archive;
};

absl::StatusOr<OpenedImage> OpenImage(int file, int folder, const ArtefactLimits& limits) {
  Fd plain;
  if (IsCompressed(file)) {
    ASSIGN_OR_RETURN(plain, Decompressed(file, folder, StreamLimit(limits)));
  }
  absl::StatusOr<ImageArchive> archive = ImageArchive::Index(plain.valid() ? plain.get() : file);
  if (!archive.ok()) return About("the image", archive.status());
  return OpenedImage{std::move(plain), *std::move(archive)};
}

}  // namespace

bool IsImageArchive(int file, int folder, const ArtefactLimits& limits) {
  if (!ImageArchive::MayBe(file)) return false;
  const absl::StatusOr<OpenedImage> image = OpenImage(file, folder, limits);
  return image.ok() && image->archive.IsImage();
}

bool MayBeImageArchive(int file) {
  if (!ImageArchive::MayBe(file) || IsCompressed(file)) return ImageArchive::MayBe(file);
  const absl::StatusOr<ImageArchive> archive = ImageArchive::Index(file);
  return archive.ok() && archive->IsImage();
}

absl::StatusOr<Artefact> UnpackImage(int file, int folder, nlohmann::json manifest,
                                     const ArtefactLimits& limits) {
  ASSIGN_OR_RETURN(const OpenedImage image, OpenImage(file, folder, limits));
  if (!image.archive.IsImage()) {
    return absl::InvalidArgumentError(
        "the image is not in a form that is accepted: write it with podman save, docker save or "
        "buildah push IMAGE oci-archive:FILE.tar");
  }
  ASSIGN_OR_RETURN(ImageContent content, image.archive.Read());
  return FromContent(image.archive, std::move(content), folder, std::move(manifest), limits);
}

std::string PolicyNameOf(const std::string& file) {
  constexpr size_t kMaxBytes = 64;
  std::string name;
  for (size_t at = 0; at < file.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(file, at);
    if (name.size() + at - begin > kMaxBytes) break;
    if (c != kBroken && !IsHarmful(c) && (c != ' ' || !name.empty())) {
      name.append(file, begin, at - begin);
    }
  }
  name.erase(name.find_last_not_of(' ') + 1);
  return name.empty() ? "policy" : name;
}

std::string NameOfTag(const std::string& tag) {
  std::string name = tag.substr(tag.rfind('/') + 1);
  if (name.ends_with(":latest")) name.resize(name.size() - 7);
  return name.empty() ? "image" : PolicyNameOf(name);
}

std::string SavedName(int file, const std::string& otherwise, const ArtefactLimits& limits) {
  const Utf8Names utf8_names;
  FileStream bytes(file);
  std::string tag;
  if (IsCompressed(file)) {
    EntryStream plain(bytes);
    // The archive has the layers with their headers, and JSON; a small file that unpacks to more is
    // not read any further.
    int64_t left = 2 * limits.bytes + kMaxImageJson;
    CheckedStream bounded(plain, "it", left);
    tag = TagIn(bounded);
  } else {
    tag = TagIn(bytes);
  }
  return tag.empty() ? PolicyNameOf(otherwise) : NameOfTag(tag);
}

}  // namespace myograde::server
