#include "server/cli/client/pages.h"

#include <cstdint>
#include <limits>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

void AddRows(const Json& page, const std::string& key, Json& all) {
  const Json rows = page.value(key, Json::array());
  if (rows.is_array()) all[key].insert(all[key].end(), rows.begin(), rows.end());
}

}  // namespace

absl::StatusOr<Json> GetAllPages(const Client& client, const std::string& path,
                                 const std::string& rows) {
  Json all = {{rows, Json::array()}, {"unreadable", Json::array()}, {"next_before", nullptr}};
  int64_t before = std::numeric_limits<int64_t>::max();
  for (;;) {
    ASSIGN_OR_RETURN(const Json page,
                     client.Get(absl::StrCat(path, "?limit=1000&before=", before)));
    AddRows(page, rows, all);
    AddRows(page, "unreadable", all);
    const Json next = page.value("next_before", Json());
    // Each page begins below the one before, so that the loop ends.
    if (!next.is_number_integer() || next.get<int64_t>() >= before) return all;
    before = next.get<int64_t>();
  }
}

}  // namespace myograde::server
