#include "server/cli/client/export_rows.h"

#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "protocol/base/status_macros.h"
#include "server/base/counted.h"

namespace myograde::server {

absl::StatusOr<std::set<std::string>> HiddenPhasesOf(const std::string& path) {
  std::set<std::string> hidden;
  std::set<std::string> revealed;
  RETURN_IF_ERROR(ForEachRow(path, [&](const std::string& table, const nlohmann::json& row) {
        const auto text = [&](const char* key) {
          const auto it = row.find(key);
          return it != row.end() && it->is_string() ? it->get<std::string>() : std::string();
        };
        if (table == "phase_event" && text("event") == "revealed") revealed.insert(text("phase"));
        if (table != "config") return absl::OkStatus();
        const nlohmann::json config =
            nlohmann::json::parse(text("effective_json"), nullptr, /*allow_exceptions=*/false);
        if (!config.is_object() || !config.contains("seed_salt")) return absl::OkStatus();
        const nlohmann::json phase = config.value("phase", nlohmann::json());
        if (phase.is_string()) hidden.insert(phase.get<std::string>());
        return absl::OkStatus();
      }));
  for (const std::string& phase : revealed) hidden.erase(phase);
  return hidden;
}

std::string RowsText(const ExportInfo& info) {
  return absl::StrCat(Counted(info.rows.at("submission"), "submission"), " and ",
                      Counted(info.rows.at("episode"), "episode"));
}

}  // namespace myograde::server
