#include "server/artefact/saved_name.h"

#include <archive_entry.h>

#include <array>
#include <map>
#include <string_view>

#include <nlohmann/json.hpp>

#include "server/artefact/byte_stream.h"
#include "server/artefact/image_archive.h"
#include "server/artefact/image_config.h"
#include "server/artefact/listing.h"

namespace myograde::server {
namespace {

constexpr std::array kNaming = {"index.json", "manifest.json", "oci-layout"};

// Ends after a number of bytes, so that a small file that unpacks to a huge one takes no time.
class CutStream : public ByteStream {
 public:
  CutStream(ByteStream& from, int64_t left) : from_(from), left_(left) {}
  absl::StatusOr<std::string_view> Next() override {
    if (left_ <= 0) return std::string_view();
    absl::StatusOr<std::string_view> piece = from_.Next();
    if (piece.ok()) left_ -= static_cast<int64_t>(piece->size());
    return piece;
  }

 private:
  ByteStream& from_;
  int64_t left_;
};

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

}  // namespace

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
    DecompressedStream plain(bytes);
    // The archive has the layers with their headers, and JSON.
    CutStream cut(plain, 2 * limits.bytes + kMaxImageJson);
    tag = TagIn(cut);
  } else {
    tag = TagIn(bytes);
  }
  return tag.empty() ? PolicyNameOf(otherwise) : NameOfTag(tag);
}

}  // namespace myograde::server
