#include "server/artefact/image_archive.h"

#include <archive_entry.h>

#include <algorithm>
#include <array>
#include <filesystem>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxMembers = 4096;
constexpr int kMaxMemberLinks = 4;
constexpr int kMaxIndexDepth = 3;
constexpr size_t kHexDigits = 64;
constexpr char kPlatform[] = "linux/amd64";

absl::Status BadImage(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("the image ", what));
}

// Whether a name begins with a digest.
bool IsHexDigest(std::string_view name) { return IsSha256Hex(name.substr(0, kHexDigits)); }

bool IsIndex(const std::string& media_type) {
  return media_type == "application/vnd.oci.image.index.v1+json" ||
         media_type == "application/vnd.docker.distribution.manifest.list.v2+json";
}

std::string BlobName(const std::string& sha256) { return "blobs/sha256/" + sha256; }

// Whether a member in a folder may belong to an image.
bool MayBeMember(const std::string& name) {
  return name.starts_with("blobs/") || IsHexDigest(name) || name.find(".tar") != std::string::npos ||
         name.ends_with(".json");
}

// Whether a manifest.json has one image, which it may list under several names.
bool ListsOneImage(const Json& images) {
  return images.is_array() && !images.empty() &&
         std::all_of(images.begin(), images.end(), [&](const Json& image) {
           return At(image, "Config") == At(images[0], "Config") &&
                  At(image, "Layers") == At(images[0], "Layers");
         });
}

struct Described {  // a content descriptor
  std::string sha256;
  int64_t size = 0;
  std::string variant;  // of the platform's processor; "": the usual one
};

struct Candidates {  // what an index lists
  std::map<std::string, Described> fitting;  // by digest
  std::vector<std::string> others;           // platforms, quoted
  absl::Status unusable;                     // why an entry that may fit can't be read
};

absl::StatusOr<std::string> ReadText(const ImageArchive& archive, const std::string& name) {
  ASSIGN_OR_RETURN(const std::string member, archive.Find(name));
  MemberStream stream = archive.Open(member);
  std::string text;
  while (std::ssize(text) <= kMaxImageJson) {
    ASSIGN_OR_RETURN(const std::string_view piece, stream.Next());
    if (piece.empty()) return text;
    text += piece;
  }
  return BadImage(absl::StrCat("has more than ", kMaxImageJson, " bytes in ", Quoted(name)));
}

absl::StatusOr<Json> ReadJson(const ImageArchive& archive, const std::string& name) {
  ASSIGN_OR_RETURN(const std::string text, ReadText(archive, name));
  return ParseJson(text, absl::StrCat("the image's ", Quoted(name)));
}

absl::StatusOr<Json> ReadBlob(const ImageArchive& archive, const Described& described,
                              const std::string& what) {
  ASSIGN_OR_RETURN(const std::string text, ReadText(archive, BlobName(described.sha256)));
  if (std::ssize(text) != described.size) {
    return BadImage(absl::StrCat("has a ", what, " of ", text.size(), " bytes where its archive "
                                 "states ", described.size, "; save the image again"));
  }
  if (Sha256Hex(text) != described.sha256) {
    return BadImage(absl::StrCat("has a ", what, " whose digest is not the stated one; save the "
                                 "image again"));
  }
  return ParseJson(text, absl::StrCat("the image's ", what));
}

absl::StatusOr<Described> Descriptor(const Json& json, const std::string& where) {
  ASSIGN_OR_RETURN(const std::string sha256, ParseDigest(TextAt(json, "digest"), where));
  const Json& size = At(json, "size");
  if (!size.is_number_unsigned() || size.get<uint64_t>() > INT64_MAX) {
    return BadImage(absl::StrCat("gives no size for its ", where));
  }
  return Described{sha256, size.get<int64_t>(), ""};
}

// The descriptor of an index's entry, whose blob must be there.
absl::StatusOr<Described> Present(const ImageArchive& archive, const Json& entry) {
  ASSIGN_OR_RETURN(Described described, Descriptor(entry, "index"));
  RETURN_IF_ERROR(archive.Find(BlobName(described.sha256)).status());
  described.variant = TextAt(At(entry, "platform"), "variant");
  return described;
}

absl::StatusOr<Json> ReadConfig(const ImageArchive& archive, const Json& manifest) {
  ASSIGN_OR_RETURN(const Described about, Descriptor(At(manifest, "config"), "config"));
  return ReadBlob(archive, about, "config");
}

// "SYSTEM/PROCESSOR" of an image by its config.
absl::StatusOr<std::string> ReadPlatform(const ImageArchive& archive, const Described& described) {
  ASSIGN_OR_RETURN(const Json manifest, ReadBlob(archive, described, "manifest"));
  ASSIGN_OR_RETURN(const Json config, ReadConfig(archive, manifest));
  return PlatformName(config);
}

// Whether a manifest is that of an image, and not of what builders add to one (signatures, bills of
// materials).
absl::StatusOr<bool> IsOfImage(const ImageArchive& archive, const Described& described) {
  ASSIGN_OR_RETURN(const Json manifest, ReadBlob(archive, described, "manifest"));
  if (!TextAt(manifest, "artifactType").empty() || manifest.contains("subject")) return false;
  const std::string kind = TextAt(At(manifest, "config"), "mediaType");
  if (kind != "application/vnd.oci.image.config.v1+json" &&
      kind != "application/vnd.docker.container.image.v1+json") {
    return false;
  }
  // Signatures have an image's config, and layers that are no archives.
  const Json& layers = At(manifest, "layers");
  return std::all_of(layers.begin(), layers.end(), [](const Json& layer) {
    const std::string layer_kind = TextAt(layer, "mediaType");
    return layer_kind.find("layer") != std::string::npos ||
           layer_kind.find("rootfs") != std::string::npos;
  });
}

absl::Status Collect(const ImageArchive& archive, const Json& index, int depth,
                     Candidates& candidates) {
  const auto other = [&](const std::string& name) {
    if (candidates.others.size() < 16) candidates.others.push_back(Quoted(name));
  };
  for (const Json& entry : At(index, "manifests")) {
    const Json& platform = At(entry, "platform");
    const bool is_index = IsIndex(TextAt(entry, "mediaType"));
    if (TextAt(platform, "os") == "unknown") continue;  // attestations
    if (!is_index && platform.is_object() && PlatformName(platform) != kPlatform) {
      other(PlatformName(platform));
      continue;
    }
    const absl::StatusOr<Described> described = Present(archive, entry);
    if (!described.ok()) {
      candidates.unusable = described.status();
      continue;
    }
    if (is_index) {
      if (depth >= kMaxIndexDepth) return BadImage("has too many nested indexes");
      ASSIGN_OR_RETURN(const Json inner, ReadBlob(archive, *described, "index"));
      RETURN_IF_ERROR(Collect(archive, inner, depth + 1, candidates));
      continue;
    }
    ASSIGN_OR_RETURN(const bool image, IsOfImage(archive, *described));
    if (!image) continue;
    if (!platform.is_object()) {
      ASSIGN_OR_RETURN(const std::string name, ReadPlatform(archive, *described));
      if (name != kPlatform) {
        other(name);
        continue;
      }
    }
    candidates.fitting.emplace(described->sha256, *described);
  }
  return absl::OkStatus();
}

absl::StatusOr<ImageContent> ReadManifest(const ImageArchive& archive, const Described& described) {
  ASSIGN_OR_RETURN(const Json manifest, ReadBlob(archive, described, "manifest"));
  ASSIGN_OR_RETURN(const Json config, ReadConfig(archive, manifest));
  ImageContent content;
  ASSIGN_OR_RETURN(content.config, ReadImageConfig(config));
  for (const Json& layer : At(manifest, "layers")) {
    const std::string kind = TextAt(layer, "mediaType");
    if (kind.find("encrypted") != std::string::npos || kind.find("foreign") != std::string::npos) {
      return BadImage(absl::StrCat("has a layer of the kind ", Quoted(kind),
                                   ", which the archive does not contain; save the image without "
                                   "such layers"));
    }
    ASSIGN_OR_RETURN(const Described stated, Descriptor(layer, "layer"));
    ASSIGN_OR_RETURN(std::string member, archive.Find(BlobName(stated.sha256)));
    content.layers.push_back({std::move(member), stated.sha256, stated.size, {}});
  }
  return content;
}

absl::StatusOr<ImageContent> ReadOci(const ImageArchive& archive) {
  ASSIGN_OR_RETURN(const Json index, ReadJson(archive, "index.json"));
  Candidates candidates;
  RETURN_IF_ERROR(Collect(archive, index, 1, candidates));
  std::map<std::string, Described>& fitting = candidates.fitting;
  if (fitting.empty() && !candidates.unusable.ok()) return candidates.unusable;
  if (fitting.empty() && !candidates.others.empty()) {
    return BadImage(absl::StrCat("is for ", absl::StrJoin(candidates.others, ", "), ", but the "
                                 "server runs linux/amd64; build it with --platform linux/amd64"));
  }
  // Of variants for newer processors, the one that runs on most.
  std::string least = fitting.empty() ? "" : fitting.begin()->second.variant;
  for (const auto& [sha256, described] : fitting) least = std::min(least, described.variant);
  std::erase_if(fitting, [&](const auto& one) { return one.second.variant != least; });
  if (fitting.size() != 1) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the archive's index.json lists ", fitting.size(), " images; save exactly one"));
  }
  ASSIGN_OR_RETURN(ImageContent content, ReadManifest(archive, fitting.begin()->second));
  content.tag = TagOfIndex(index);
  return content;
}

absl::StatusOr<ImageContent> ReadDocker(const ImageArchive& archive) {
  ASSIGN_OR_RETURN(const Json images, ReadJson(archive, "manifest.json"));
  if (images.contains("schemaVersion")) {
    return absl::InvalidArgumentError(
        "the archive has an image as written by \"skopeo copy IMAGE dir:FOLDER\"; save it with "
        "\"skopeo copy IMAGE oci-archive:FILE.tar\"");
  }
  if (!ListsOneImage(images)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the archive's manifest.json lists ", images.is_array() ? images.size() : 0,
        " images; save exactly one"));
  }
  const Json& image = images[0];
  const std::string config_name = TextAt(image, "Config");
  ASSIGN_OR_RETURN(const std::string text, ReadText(archive, config_name));
  // Its name is its digest, wherever tools put it.
  const std::string base = config_name.substr(config_name.rfind('/') + 1);
  if (IsHexDigest(base) && Sha256Hex(text) != base.substr(0, kHexDigits)) {
    return BadImage("has a config whose name is not its digest; save the image again");
  }
  ASSIGN_OR_RETURN(const Json config, ParseJson(text, "the image's config"));
  ImageContent content;
  ASSIGN_OR_RETURN(content.config, ReadImageConfig(config));
  for (const Json& layer : At(image, "Layers")) {
    if (!layer.is_string()) return BadImage("lists a layer that is not a name");
    ASSIGN_OR_RETURN(std::string member, archive.Find(layer.get<std::string>()));
    content.layers.push_back({.member = std::move(member), .sha256 = {}, .diff_id = {}});
  }
  content.tag = TagOfDockerManifest(images);
  return content;
}

}  // namespace

std::string PlatformName(const Json& json) {
  return absl::StrCat(TextAt(json, "os"), "/", TextAt(json, "architecture"));
}

std::string PlainMemberName(const std::string& name) {
  std::string plain = std::filesystem::path("/" + name).lexically_normal().string().substr(1);
  while (plain.ends_with('/')) plain.pop_back();
  return plain;
}

bool ImageArchive::MayBe(int file) {
  FileStream stream(file);
  EntryStream bytes(stream);
  const bool compressed = IsCompressed(file);
  StreamArchive archive(compressed ? static_cast<ByteStream&>(bytes) : stream,
                        StreamArchive::Form::kTar);
  if (!archive.Open().ok()) return false;
  bool lists = false;
  for (size_t members = 0; members < kMaxMembers; ++members) {
    archive_entry* entry = nullptr;
    const absl::StatusOr<bool> found = archive.NextEntry(&entry);
    if (!found.ok() || !*found) return lists;
    const char* raw = archive_entry_pathname(entry);
    if (raw == nullptr) return false;
    const std::string name = PlainMemberName(raw);
    if (name == "policy.json") return false;
    lists = lists || name == "manifest.json" || name == "index.json";
    const bool in_folder = archive_entry_filetype(entry) != AE_IFDIR && name.find('/') != std::string::npos;
    if (compressed && in_folder && !MayBeMember(name)) return false;
  }
  return lists;
}

absl::StatusOr<ImageArchive> ImageArchive::Index(int file) {
  FileStream stream(file);
  StreamArchive archive(stream, StreamArchive::Form::kTar);
  RETURN_IF_ERROR(archive.Open());
  ImageArchive image;
  image.file_ = file;
  for (;;) {
    archive_entry* entry = nullptr;
    ASSIGN_OR_RETURN(const bool found, archive.NextEntry(&entry));
    if (!found) return image;
    RETURN_IF_ERROR(image.Take(entry, archive.header_position()));
  }
}

absl::Status ImageArchive::Take(archive_entry* entry, int64_t position) {
  const char* raw = archive_entry_pathname(entry);
  if (raw == nullptr) return BadImage("has a member without a name");
  const std::string name = PlainMemberName(raw);
  Member member = {.position = position, .size = archive_entry_size(entry), .link = {}};
  if (const char* target = archive_entry_hardlink(entry); target != nullptr) {
    member.link = PlainMemberName(target);
  } else if (archive_entry_filetype(entry) == AE_IFLNK) {
    const char* text = archive_entry_symlink(entry);
    const std::string folder = name.substr(0, name.rfind('/') + 1);  // all of it, or ""
    member.link = PlainMemberName((name.find('/') == std::string::npos ? "" : folder) +
                            (text == nullptr ? "" : text));
  } else if (archive_entry_filetype(entry) == AE_IFDIR) {
    return absl::OkStatus();
  } else if (archive_entry_filetype(entry) != AE_IFREG) {
    return BadImage(absl::StrCat("has the member ", Quoted(name), ", which is not a file"));
  } else if (archive_entry_sparse_count(entry) > 0) {
    return BadImage(absl::StrCat("has the member ", Quoted(name), ", which is a sparse file"));
  }
  if (const auto [there, added] = members_.emplace(name, member); !added) {
    ASSIGN_OR_RETURN(const bool equal, Equal(there->second, member));
    if (!equal) {
      return BadImage(absl::StrCat("has the member ", Quoted(name), " twice, with other content"));
    }
  }
  if (members_.size() > kMaxMembers) return BadImage("has too many members for an image");
  return absl::OkStatus();
}

absl::StatusOr<bool> ImageArchive::Equal(const Member& a, const Member& b) const {
  if (a.size != b.size || a.link != b.link) return false;
  if (!a.link.empty()) return true;
  std::array<std::string, 2> digests;
  for (size_t i = 0; i < digests.size(); ++i) {
    MemberStream stream(file_, i == 0 ? a.position : b.position);
    int64_t left = a.size;
    CheckedStream checked(stream, "a member", left);
    RETURN_IF_ERROR(checked.Finish());
    digests[i] = checked.sha256();
  }
  return digests[0] == digests[1];
}

bool ImageArchive::IsImage() const {
  if (members_.contains("policy.json")) return false;
  return members_.contains("manifest.json") || IsOci();
}

absl::StatusOr<std::string> ImageArchive::Find(const std::string& name) const {
  std::string at = PlainMemberName(name);
  for (int link = 0; link <= kMaxMemberLinks; ++link) {
    const auto found = members_.find(at);
    if (found == members_.end()) break;
    if (found->second.link.empty()) return at;
    at = found->second.link;
  }
  return BadImage(absl::StrCat("names its member ", Quoted(name),
                               ", which is not in the archive; save the image again"));
}

absl::StatusOr<ImageContent> ImageArchive::Read() const {
  // Newer versions of Docker write both; OCI's has more digests.
  ASSIGN_OR_RETURN(ImageContent content, IsOci() ? ReadOci(*this) : ReadDocker(*this));
  const std::vector<std::string>& diff_ids = content.config.diff_ids;
  if (content.layers.size() != diff_ids.size()) {
    return BadImage(absl::StrCat("has ", content.layers.size(), " layers, and its config lists ",
                                 diff_ids.size(), "; save the image again"));
  }
  for (size_t i = 0; i < diff_ids.size(); ++i) content.layers[i].diff_id = diff_ids[i];
  return content;
}

}  // namespace myograde::server
