#include "server/store/artefact_options.h"

#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"
#include "protocol/lease/policy_image.h"

namespace myograde::server {

std::string ArtefactOptionsOf(const ArtefactRow& artefact) {
  nlohmann::json options = nlohmann::json::object();
  if (!artefact.adapter.empty()) options["adapter"] = artefact.adapter;
  if (artefact.extra_observations) options["extra_observations"] = true;
  if (artefact.image.has_value()) options["image"] = PolicyImageToJson(*artefact.image);
  return CanonicalJson(options);
}

void ReadArtefactOptions(StoredRow& row, int column, ArtefactRow& artefact) {
  const std::string text = row.Object(column);
  if (!row.ok()) return;
  const nlohmann::json options = nlohmann::json::parse(text);
  ConfigReader reader(options, "options");
  if (reader.Has("adapter")) artefact.adapter = reader.String("adapter");
  if (reader.Has("extra_observations")) {
    artefact.extra_observations = reader.Boolean("extra_observations");
  }
  if (reader.Has("image")) {
    absl::StatusOr<PolicyImage> image =
        PolicyImageFromJson(reader.Object("image"), "options: image");
    if (!image.ok()) return row.Fail(column, std::string(image.status().message()));
    artefact.image = *std::move(image);
  }
  if (const absl::Status read = reader.Finish(); !read.ok()) {
    row.Fail(column, std::string(read.message()));
  }
}

}  // namespace myograde::server
