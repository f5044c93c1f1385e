// A transaction of the store: what is read and changed in it belongs to nouns, which have a file
// each. Reading takes a const one. Looking up a missing id is a NotFoundError. Unreadable rows are
// reported as in damage.h: a query for a single answer fails, lists leave the row out and log it.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include <absl/status/status.h>

#include "server/base/data_folder.h"
#include "server/store/blocks.h"
#include "server/store/callers.h"
#include "server/store/content.h"
#include "server/store/context.h"
#include "server/store/deliveries.h"
#include "server/store/episodes.h"
#include "server/store/evaluations.h"
#include "server/store/journal.h"
#include "server/store/phases.h"
#include "server/store/quota.h"
#include "server/store/rejudges.h"
#include "server/store/submissions.h"
#include "server/store/teams.h"
#include "server/store/transfer.h"

namespace myograde::server {

class Transaction {
 public:
  explicit Transaction(TransactionContext context) : context_(std::move(context)) {}
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;

  // What the journal says: marks, choices, phases, teams, configs and rejudges, and what counts on
  // boards. Valid until an act is added.
  const BoardState& Board() const { return context_.Board(); }

  // Grows with whatever may change a board, so that a kept board is never stale.
  int64_t BoardChanges() const { return Board().board_changes() + episodes.TimesDropped(); }

  // One of several changes that share a transaction: if it fails, or the schema rejects one of its
  // rows, all of it is rolled back and the others go on.
  absl::Status Part(const std::function<absl::Status(Transaction&)>& change);
  // Notes a time (ms) for Store::trusted_time_ms(); an earlier one than is there changes nothing.
  void SetTrustedTime(int64_t ms);
  // The data folder that the store is at home in; nullopt: none was recorded yet.
  std::optional<DataHome> Home() const;
  void SetHome(const DataHome& home);
  // The whole store as one document, in transfer.h's format.
  absl::Status Export(const ExportSink& sink) const { return ExportRows(context_.db, sink); }
  // Fills an empty store; errors as in transfer.h. Evaluations that had not ended when exported end
  // as cancelled, as exports have no artefact files. `check`: what the store's readers can't tell
  // of its new rows; its error undoes the whole.
  absl::Status Import(const std::string& path, const ExportInfo& info, const std::string& who,
                      const std::function<absl::Status(const Transaction&)>& check);

 private:
  const TransactionContext context_;

 public:
  Submissions submissions{context_};
  Evaluations evaluations{context_};
  Blocks blocks{context_};
  Episodes episodes{context_};
  Teams teams{context_};
  Callers callers{context_};
  Journal journal{context_};
  PhaseActs phases{context_};
  Rejudges rejudges{context_};
  Content content{context_};
  Quotas quotas{context_};
  Deliveries deliveries{context_};
};

}  // namespace myograde::server
