// The journal: every act that decides what stands on a board or that the public record tells, each
// added in the transaction of what it does (schema.sql; server/board/acts.h has the kinds). The public
// record is its public part. What follows from it is a BoardState, which is folded once and then follows
// what is written.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/mutex.h"
#include "server/board/board_state.h"
#include "server/store/damage.h"

namespace SQLite {
class Database;
}

namespace myograde::server {

class ReaderPool;

struct NewAct {
  std::string kind;
  std::string who;
  nlohmann::json content;  // the keys of the public record
  nlohmann::json beside = nlohmann::json::object();  // the private keys
  bool is_public = true;   // false: the record has no entry of it
  int64_t evaluation = 0;  // that it is the end of; 0: none
};

inline nlohmann::json OrNull(const std::string& text) {
  return text.empty() ? nlohmann::json() : nlohmann::json(text);
}
inline nlohmann::json OrNull(int64_t id) { return id == 0 ? nlohmann::json() : nlohmann::json(id); }

// Adds an act at the end. A disk's fault or a stranger's edit of the last row does not keep what follows
// out: the chain goes on from what is there, and a check of the chain tells where it broke. Internal to
// the store; throws SQLite::Exception.
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

// An entry of the public record.
struct RecordRow {
  int64_t index = 0;
  std::string entry_json;
  std::string chain;
};

// The chain's value at an entry: the SHA-256 over the value at the entry before ("" for the first), a line
// feed and the entry.
std::string ChainOf(std::string_view before, std::string_view entry_json);

// What is wrong at an entry: nullptr if it can't be read or is gone. `before`: the chain at the entry
// before, "" for the first. "": nothing.
std::string ChainMistake(const std::string& before, const RecordRow* entry);

// The first entries, so many at most, at which the chain breaks. Errors of ReaderPool::Read.
absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most);

}  // namespace myograde::server
