#include "server/store/transaction.h"

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"
#include "server/store/team_names.h"

namespace myograde::server {

absl::Status Transaction::Part(const std::function<absl::Status(Transaction&)>& change) {
  return context_.Part([&] { return change(*this); });
}

void Transaction::SetTrustedTime(int64_t ms) {
  int64_t before = 0;
  if (!absl::SimpleAtoi(Meta(context_.db, "trusted_time"), &before) || before < ms) {
    SetMeta(context_.db, "trusted_time", absl::StrCat(ms));
  }
}

absl::Status Transaction::Import(const std::string& path, const ExportInfo& info,
                                 const std::string& who,
                                 const std::function<absl::Status(const Transaction&)>& check) {
  RETURN_IF_ERROR(ImportRows(context_.db, path, info));
  FillTeamSkeletons(context_.db);
  if (absl::Status read = check(*this); !read.ok()) {
    if (!ExtractDamage(read).has_value()) return read;
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": has a row that no request could read (", read.message(),
                     "); nothing was imported: export again from a store that is well"));
  }
  constexpr char kWhy[] = "had not ended when it was exported; submit it again";
  for (const int64_t evaluation :
       AllNumbers(context_.db, "SELECT id FROM evaluation WHERE finished_at IS NULL ORDER BY id")) {
    RETURN_IF_ERROR(evaluations.EndWithLeases(evaluation, EvaluationState::kCancelled, kWhy, who));
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
