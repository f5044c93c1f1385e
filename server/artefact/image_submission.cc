#include "server/artefact/submission.h"

#include <archive_entry.h>
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <map>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/fd.h"
#include "protocol/base/file.h"
#include "protocol/base/status_macros.h"
#include "server/artefact/byte_stream.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/listing.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

// What a layer's headers take beside its files: an entry's own with a long name, and padding.
constexpr int64_t kHeaderBytes = 4096;
constexpr int64_t kPaddingBytes = 8 << 20;
constexpr char kDecompressed[] = ".decompressed";

// The archive itself, decompressed into a file of `folder` that has no name, if it is compressed:
// what it holds is read in another order.
absl::StatusOr<Fd> Decompressed(int file, int folder, int64_t limit) {
  Fd plain(::openat(folder, kDecompressed, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!plain.valid() || ::unlinkat(folder, kDecompressed, 0) != 0) {
    return HostError("can't create a file for the decompressed image");
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

int64_t StreamLimit(const ArtefactLimits& limits) {
  return limits.bytes + 2 * limits.files * kHeaderBytes + kPaddingBytes;
}

absl::Status About(absl::string_view what, const absl::Status& status) {
  if (!absl::IsInvalidArgument(status)) return status;
  return absl::InvalidArgumentError(absl::StrCat(what, ": ", status.message()));
}

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
        "the image's format is not supported: write it with podman save, docker save or "
        "buildah push IMAGE oci-archive:FILE.tar");
  }
  ASSIGN_OR_RETURN(ImageContent content, image.archive.Read());
  return MakeImage(image.archive, std::move(content), folder, std::move(manifest), limits);
}

std::string PolicyNameOf(const std::string& file) {
  constexpr size_t kMaxBytes = 64;
  std::string name;
  for (size_t at = 0; at < file.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(file, at);
    if (name.size() + at - begin > kMaxBytes) break;
    if (c != kBroken && !IsUnsafe(c) && (c != ' ' || !name.empty())) {
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
