// Container images: their JSON, which is untrusted and has keys that mean nothing here, and their
// outer archive, an uncompressed tar of JSON files and layers, in OCI's layout or in Docker's.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/policy_image.h"
#include "server/artefact/artefact.h"
#include "server/artefact/byte_stream.h"
#include "server/base/json_value.h"

namespace myograde::server {

struct ImageConfig {
  std::vector<std::string> command;    // Entrypoint and Cmd
  PolicyImage image;                   // its user is not looked up yet
  std::string user;                    // as in the config
  std::vector<std::string> diff_ids;   // hex SHA-256 of the layers' tars
};

// Reads an image's config. InvalidArgumentError: it is for another system or processor, or breaks a
// rule.
absl::StatusOr<ImageConfig> ReadImageConfig(const nlohmann::json& json);

// "SYSTEM/PROCESSOR" of a platform, or of an image's config.
std::string PlatformName(const nlohmann::json& json);

// The tag that an image was saved by, as an archive's manifest.json (Docker's) or index.json
// (OCI's) has it; "": none.
std::string TagOfDockerManifest(const nlohmann::json& manifest);
std::string TagOfIndex(const nlohmann::json& index);

// The hexadecimal digits of "sha256:HEX". `where` names it in the error.
absl::StatusOr<std::string> ParseDigest(std::string_view text, std::string_view where);

// The user and group inside the sandbox for an image's "USER[:GROUP]", by its /etc/passwd and
// /etc/group, which are untrusted. Root, and an image without a user, become `image`'s defaults.
// Sets HOME as engines do, unless the image's environment has it: the user's folder in /etc/passwd.
absl::Status FindUser(std::string_view user, std::string_view passwd, std::string_view group,
                      PolicyImage& image);

inline constexpr int64_t kMaxImageJson = 4 << 20;  // bytes of one JSON file in it

// A member's name without "." and "..", which leads nowhere else.
std::string PlainMemberName(const std::string& name);

// One member of the archive as a stream.
class MemberStream : public ByteStream {
 public:
  MemberStream(int file, int64_t position)
      : file_(file, position), content_(file_, StreamArchive::Form::kTar) {}
  absl::StatusOr<std::string_view> Next() override { return content_.Next(); }

 private:
  FileStream file_;
  EntryStream content_;
};

struct ImageLayer {
  std::string member;   // its name in the archive
  std::string sha256;   // hex, of the layer as it is in the archive; "": not stated
  int64_t size = -1;    // likewise; -1: not stated
  std::string diff_id;  // hex SHA-256 of the layer's tar
};

struct ImageContent {
  ImageConfig config;
  std::vector<ImageLayer> layers;  // the lowest first
  std::string tag;                 // the name that it was saved by; "": none
};

class ImageArchive {
 public:
  // True if the archive may be an image: it has an image's list of content, and no policy.json. Of a
  // compressed archive, stops at the first member that no image has.
  static bool MayBe(int file);

  // Lists the members. `file` must outlive it. InvalidArgumentError: it is not a tar, or has more
  // members than an image can have.
  static absl::StatusOr<ImageArchive> Index(int file);

  bool IsImage() const;

  // Reads and checks all but the layers. InvalidArgumentError: the image breaks a rule, with what
  // and what to do.
  absl::StatusOr<ImageContent> Read() const;

  // The member that a name stands for, through links.
  absl::StatusOr<std::string> Find(const std::string& name) const;
  // A member that is there.
  MemberStream Open(const std::string& member) const {
    return MemberStream(file_, members_.at(member).position);
  }
  int64_t SizeOf(const std::string& member) const { return members_.at(member).size; }

 private:
  struct Member {
    int64_t position = 0;
    int64_t size = 0;
    std::string link;  // "": a file
  };
  bool IsOci() const { return members_.contains("oci-layout") && members_.contains("index.json"); }
  absl::Status Take(archive_entry* entry, int64_t position);
  // Whether two members have the same bytes.
  absl::StatusOr<bool> Equal(const Member& a, const Member& b) const;
  int file_ = -1;
  std::map<std::string, Member> members_;
};

// Makes the files of an image whose archive was read in the empty `folder`, and its policy.json, as
// UnpackImage says (submission.h).
absl::StatusOr<Artefact> MakeImage(const ImageArchive& archive, ImageContent content, int folder,
                                   nlohmann::json manifest, const ArtefactLimits& limits);

// All bytes that the image's layers and archive may yield, decompressed.
int64_t StreamLimit(const ArtefactLimits& limits);

// An InvalidArgumentError with `what` in front; any other status as it is.
absl::Status About(absl::string_view what, const absl::Status& status);

}  // namespace myograde::server
