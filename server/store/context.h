// What all parts of a transaction share, and the journal that they write (journal.cc). Internal to
// the store.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/status.h>
#include <nlohmann/json.hpp>

#include "protocol/base/mutex.h"
#include "server/base/json_value.h"
#include "server/board/board_state.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

struct WebhookConfig;

// NotFoundError: "there is no evaluation 7".
absl::Status NoSuch(const char* what, int64_t id);

struct NewAct {
  std::string kind;
  std::string who;
  nlohmann::json content;  // the keys of the public record
  nlohmann::json beside = nlohmann::json::object();  // the private keys
  bool is_public = true;   // false: the record has no entry of it
  int64_t evaluation = 0;  // that it is the end of; 0: none
};

// Adds an act at the end. A disk's fault or a stranger's edit of the last row does not keep what
// follows out: the chain goes on from what is there, and a check of the chain tells where it broke.
// Internal to the store; throws SQLite::Exception.
void AppendAct(SQLite::Database& db, int64_t now_ms, const NewAct& act);

// Applies to a state what the journal has beyond it. What can't be applied is told by
// BoardState::damaged. Throws SQLite::Exception.
void CatchUp(SQLite::Database& db, BoardState& state);

// The state that the journal leads to, for connections of any thread.
class BoardFold {
 public:
  // As this connection sees the journal. Throws SQLite::Exception.
  std::shared_ptr<const BoardState> Follow(SQLite::Database& db);

 private:
  Mutex mutex_;
  std::shared_ptr<const BoardState> state_ ABSL_GUARDED_BY(mutex_);
};

// A state that has seen acts which are not in the journal any more is folded anew.
void ForgetRolledBack(SQLite::Database& db, BoardState& board);

// A transaction on one connection. The state of the journal is that of its writer, or follows
// `fold`.
struct TransactionContext {
  SQLite::Database& db;
  BoardFold* fold = nullptr;
  BoardState* state = nullptr;
  int64_t now_ms = 0;  // of a change
  const std::vector<WebhookConfig>* webhooks = nullptr;  // who is told; nullptr: nobody
  mutable std::shared_ptr<const BoardState> followed = {};

  // What the journal says, with what this change has added. Valid until more is added.
  const BoardState& Board() const;
  absl::Status Part(const std::function<absl::Status()>& change) const;
};

// A noun of the store, within a transaction.
class StorePart {
 public:
  explicit StorePart(const TransactionContext& context)
      : context_(context), db_(context.db), now_ms_(context.now_ms) {}

 protected:
  const BoardState& Board() const { return context_.Board(); }
  void Append(const NewAct& act) { AppendAct(db_, now_ms_, act); }
  // Adds a row that says who changed a state, and why.
  absl::Status Audit(const char* entity, int64_t id, std::string_view from, std::string_view to,
                     const std::string& who, const std::string& why);
  absl::Status Part(const std::function<absl::Status()>& change) { return context_.Part(change); }

  const TransactionContext& context_;
  SQLite::Database& db_;
  const int64_t now_ms_;
};

}  // namespace myograde::server
