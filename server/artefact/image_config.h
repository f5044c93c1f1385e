// The JSON of container images: untrusted, and with keys that mean nothing here.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/lease/policy_image.h"

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

// Values of an object; harmless ones if `json` is no object or the value has another type.
std::string TextAt(const nlohmann::json& json, std::string_view key);
const nlohmann::json& At(const nlohmann::json& json, std::string_view key);

// The tag that an image was saved by, as an archive's manifest.json (Docker's) or index.json (OCI's)
// has it; "": none.
std::string TagOfDockerManifest(const nlohmann::json& manifest);
std::string TagOfIndex(const nlohmann::json& index);

// The hexadecimal digits of "sha256:HEX". `where` names it in the error.
absl::StatusOr<std::string> DigestOf(std::string_view text, std::string_view where);

// The user and group inside the sandbox for an image's "USER[:GROUP]", by its /etc/passwd and
// /etc/group, which are untrusted. Root, and an image without a user, become `image`'s defaults. Sets
// HOME as engines do, unless the image's environment has it: the user's folder in /etc/passwd.
absl::Status FindUser(std::string_view user, std::string_view passwd, std::string_view group,
                      PolicyImage& image);

}  // namespace myograde::server
