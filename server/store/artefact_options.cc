#include "server/store/artefact_options.h"

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/config_reader.h"

namespace myograde::server {

std::string ArtefactOptionsText(const ArtefactRow& artefact) {
  nlohmann::json options = nlohmann::json::object();
  if (!artefact.adapter.empty()) options["adapter"] = artefact.adapter;
  return CanonicalJson(options);
}

void ReadArtefactOptions(StoredRow& row, int column, ArtefactRow& artefact) {
  const auto options =
      nlohmann::json::parse(row.Object(column), nullptr, /*allow_exceptions=*/false);
  if (!row.ok()) return;
  ConfigReader reader(options, "options_json");
  if (reader.Has("adapter")) artefact.adapter = reader.String("adapter");
  if (const absl::Status status = reader.Finish(); !status.ok()) {
    row.Fail(column, std::string(status.message()));
  }
}

}  // namespace myograde::server
