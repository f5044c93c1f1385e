#include "server/store/transaction.h"

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"
#include "server/store/connection.h"

namespace myograde::server {

absl::Status NoSuch(const char* what, int64_t id) {
  return absl::NotFoundError(absl::StrCat("there is no ", what, " ", id));
}

const BoardState& TransactionContext::Board() const {
  if (state != nullptr) {
    CatchUp(db, *state);
    return *state;
  }
  if (followed == nullptr) followed = fold->Follow(db);
  return *followed;
}

absl::Status StorePart::Audit(const char* entity, int64_t id, std::string_view from,
                              std::string_view to, const std::string& who, const std::string& why) {
  Run(db_, R"(INSERT INTO transition (at, entity, entity_id, from_state, to_state, who, why)
      VALUES (?, ?, ?, ?, ?, ?, ?))",
      now_ms_, entity, id, from, to, who, why);
  return absl::OkStatus();
}

absl::Status TransactionContext::Part(const std::function<absl::Status()>& change) const {
  db.exec("SAVEPOINT part");
  absl::Status status;
  try {
    status = change();
  } catch (const SQLite::Exception& error) {
    status = StatusOf("the store", error);
    if (!absl::IsFailedPrecondition(status)) throw;  // not just of this part
  }
  if (!status.ok()) {
    db.exec("ROLLBACK TO part");
    ForgetRolledBack(db, *state);
  }
  db.exec("RELEASE part");
  return status;
}

absl::Status Transaction::Part(const std::function<absl::Status(Transaction&)>& change) {
  return context_.Part([&] { return change(*this); });
}

void Transaction::SetTrustedTime(int64_t ms) {
  if (MetaNumber(context_.db, "trusted_time") < ms) {
    SetMeta(context_.db, "trusted_time", absl::StrCat(ms));
  }
}

std::optional<DataHome> Transaction::Home() const {
  const std::string text = Meta(context_.db, "home");
  if (text.empty()) return std::nullopt;
  const size_t key = text.find('\n');
  return DataHome{text.substr(0, key), key == std::string::npos ? "" : text.substr(key + 1)};
}

void Transaction::SetHome(const DataHome& home) {
  SetMeta(context_.db, "home", absl::StrCat(home.key, "\n", home.place));
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
  for (const int64_t evaluation : AllValues<int64_t>(
           context_.db, "SELECT id FROM evaluation WHERE finished_at IS NULL ORDER BY id")) {
    RETURN_IF_ERROR(evaluations.EndWithBlocks(evaluation, EvaluationState::kCancelled, kWhy, who));
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
