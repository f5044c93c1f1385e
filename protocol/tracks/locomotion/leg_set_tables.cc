// The default parameter sets of a policy's leg, as a table.
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/policy/leg_parameters.h"
#include "protocol/tracks/locomotion/track.h"

namespace myograde {
namespace locomotion {
namespace {

using Json = nlohmann::json;

std::string JointText(const Json& joint) {
  return absl::StrCat(joint["stiffness"].dump(), ", ", joint["damping"].dump(), ", ",
                      joint["target_deg"].dump());
}

void AddRows(size_t number, const Json& set, std::vector<std::vector<std::string>>& rows) {
  for (const char* state : kLegStateKeys) {
    const Json& said = set[state];
    std::vector<std::string> until;
    for (const auto& [key, value] : said["until"].items()) {
      until.push_back(absl::StrCat(key, " ", value.dump()));
    }
    rows.push_back({absl::StrCat(number, " ", set.value("name", "")), state,
                    JointText(said["knee"]), JointText(said["ankle"]),
                    absl::StrJoin(until, ", or ")});
  }
}

}  // namespace
}  // namespace locomotion

std::vector<RulesTable> LegSetTables(const nlohmann::json& rules) {
  RulesTable table{.key = "/leg/parameter_sets",
                   .summary = "all the official default",
                   .title = "Parameter sets of the prosthesis until a policy uploads its own",
                   .note = "stiffness in N m/rad, damping in N m s/rad, target in degrees; loads "
                           "in parts of the person's weight",
                   .head = {"set", "state", "knee", "ankle", "left when"},
                   .rows = {}};
  const nlohmann::json sets =
      rules.value(nlohmann::json::json_pointer(table.key), nlohmann::json::array());
  std::vector<std::string> names;
  for (const nlohmann::json& set : sets) {
    locomotion::AddRows(names.size(), set, table.rows);
    names.push_back(set.value("name", ""));
  }
  if (!names.empty()) table.summary = absl::StrJoin(names, ", ");
  return {table};
}

}  // namespace myograde
