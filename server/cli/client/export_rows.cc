#include "server/cli/client/export_rows.h"

#include <absl/strings/str_cat.h>

#include "server/base/counted.h"

namespace myograde::server {

std::string RowsText(const ExportInfo& info) {
  return absl::StrCat(Counted(info.rows.at("submission"), "submission"), " and ",
                      Counted(info.rows.at("episode"), "episode"));
}

}  // namespace myograde::server
