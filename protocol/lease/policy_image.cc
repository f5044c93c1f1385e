#include "protocol/lease/policy_image.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"

namespace myograde {

bool IsReplacedByTheSandbox(std::string_view top) {
  return top == "proc" || top == "dev" || top == "tmp" || top == "myograde";
}

nlohmann::json PolicyImageToJson(const PolicyImage& image) {
  return {{"environment", image.environment},
          {"working_dir", image.working_dir},
          {"uid", image.uid},
          {"gid", image.gid}};
}

absl::StatusOr<PolicyImage> PolicyImageFromJson(const nlohmann::json& json,
                                                std::string_view where) {
  ConfigReader reader(json, std::string(where));
  PolicyImage image;
  image.environment = reader.StringsByName("environment");
  image.working_dir = reader.String("working_dir");
  image.uid = reader.Integer("uid", 1, INT32_MAX);
  image.gid = reader.Integer("gid", 1, INT32_MAX);
  if (!image.working_dir.starts_with('/')) reader.Fail("working_dir", "must be an absolute path");
  RETURN_IF_ERROR(reader.Finish());
  return image;
}

nlohmann::json ManifestToJson(const PolicyManifest& manifest) {
  nlohmann::json json = {{"name", manifest.name},
                         {"command", manifest.command},
                         {"runtimes", manifest.runtimes},
                         {"env", manifest.environment},
                         {"extra_observations", manifest.extra_observations}};
  if (!manifest.adapter.empty()) json["adapter"] = manifest.adapter;
  if (manifest.image.has_value()) json["image"] = PolicyImageToJson(*manifest.image);
  return json;
}

absl::StatusOr<PolicyManifest> ManifestFromJson(const nlohmann::json& json,
                                                std::string_view where) {
  ConfigReader reader(json, std::string(where));
  PolicyManifest manifest{.name = reader.String("name"),
                          .command = reader.Strings("command"),
                          .runtimes = reader.Strings("runtimes"),
                          .environment = reader.StringsByName("env"),
                          .extra_observations = reader.Boolean("extra_observations")};
  if (manifest.command.empty()) reader.Fail("command", "has no program");
  if (reader.Has("adapter")) manifest.adapter = reader.String("adapter");
  if (reader.Has("image")) {
    ASSIGN_OR_RETURN(manifest.image, PolicyImageFromJson(reader.Object("image"),
                                                         absl::StrCat(reader.where(), ": image")));
  }
  RETURN_IF_ERROR(reader.Finish());
  return manifest;
}

}  // namespace myograde
