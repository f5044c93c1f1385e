// A submission that is a container image: how its program is started in it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde {

struct PolicyImage {
  // Of the image's config, without the variables that are the grader's.
  std::map<std::string, std::string> environment;
  std::string working_dir = "/";  // absolute
  // Inside the sandbox. An image's root becomes the user of every other policy.
  int64_t uid = 1000;
  int64_t gid = 1000;

  bool operator==(const PolicyImage&) const = default;
};

// The folder of an unpacked image in its artefact's folder.
inline constexpr char kImageFolder[] = "image";

// The /etc/hosts of an image in its sandbox. 2024's agents look for their simulator at
// "environment".
inline constexpr char kImageHosts[] = "127.0.0.1 localhost myograde environment\n::1 localhost\n";

// Names at the top of an image that its sandbox replaces by its own. What an image has there is left
// out.
bool IsReplacedByTheSandbox(std::string_view top);

nlohmann::json PolicyImageToJson(const PolicyImage& image);
// `where` names the object in errors.
absl::StatusOr<PolicyImage> PolicyImageFromJson(const nlohmann::json& json, std::string_view where);

}  // namespace myograde
