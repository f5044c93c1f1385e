// What a submission's policy.json asks for, and how its program is started where it is a container
// image.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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

// The content of policy.json.
struct PolicyManifest {
  std::string name;                   // shown to people; 1 to 64 bytes
  // command[0] is an absolute path, a relative one (inside the artefact) with a slash in it, or a
  // word to be looked up in PATH.
  std::vector<std::string> command;
  std::vector<std::string> runtimes = {};  // names of the server's runtimes that it needs
  std::map<std::string, std::string> environment = {};  // variables to set for the policy
  std::string adapter = {};  // of server/artefact/adapters.h, which plays the command; "": none
  bool extra_observations = false;  // observations carry the track's extra entries too
  // A container image is submitted: its files are in the folder kImageFolder, and the command
  // starts in it.
  std::optional<PolicyImage> image = {};
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

// By the keys of policy.json; "image" is an object.
nlohmann::json ManifestToJson(const PolicyManifest& manifest);
absl::StatusOr<PolicyManifest> ManifestFromJson(const nlohmann::json& json, std::string_view where);

}  // namespace myograde
