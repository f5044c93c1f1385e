#include "protocol/lease/policy_image.h"

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

}  // namespace myograde
