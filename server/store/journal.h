// The journal: every act that decides what stands on a board or that the public record tells, each
// added in the transaction of what it does (schema.sql; server/board/acts.h has the kinds). The
// public record is its public part. What follows from it is a BoardState, which is folded once and
// then follows what is written.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>

#include "server/store/context.h"
#include "server/store/damage.h"

namespace myograde::server {

// An entry of the public record.
struct RecordRow {
  int64_t index = 0;
  std::string entry_json;
  std::string chain;
};

// The chain's value at an entry: the SHA-256 over the value at the entry before ("" for the first),
// a line feed and the entry.
std::string ExtendChain(std::string_view before, std::string_view entry_json);

// The config that a board has from now on.
struct NewBoardConfig {
  BoardName board;
  std::string config;            // hash
  std::string config_json = "";  // canonical; "": the store has it
  int64_t rejudge = 0;           // whose act it is; 0: the config files changed
};

// Acts on boards, and the public record.
class Journal : StorePart {
 public:
  using StorePart::StorePart;

  // The public record: the index that the next entry gets, entries from an index on, and the entry
  // with an evaluation's result (NotFoundError: there is none).
  int64_t RecordSize() const;
  Listed<RecordRow> Record(int64_t from, int64_t limit) const;
  // Passes on each entry from an index on (nullptr: it can't be read, or is gone), with what is
  // wrong there, until it returns false. `chain`: at the entry before; "" for the first.
  void ForEachEntry(int64_t from, std::string chain,
                    const std::function<bool(const RecordRow* entry, std::optional<Damage> damage)>&
                        on_entry) const;
  absl::StatusOr<RecordRow> GradedEntry(int64_t evaluation) const;
  // Sets or clears a mark; true if that changed anything (setting it again for the same reason does
  // not). NotFoundError if there is no such submission.
  absl::StatusOr<bool> Mark(int64_t submission, const std::string& mark, bool set,
                            const std::string& who, const std::string& why);
  // Makes a submission the one that its team stands with among those under the same config; true if
  // that changed anything. NotFoundError if there is no such submission; FailedPreconditionError if
  // it is not ranked, or not done.
  absl::StatusOr<bool> Choose(int64_t submission, const std::string& who);
  // Gives a board its config from now on; true if it had another one. A rejudge's act is always
  // added. FailedPreconditionError if the store has neither the config nor its JSON.
  absl::StatusOr<bool> SetBoardConfig(const NewBoardConfig& change, const std::string& who);
  // Adds to the public record (journal.h) the key that signs from now on, unless it is the latest
  // one already.
  absl::Status AppendKey(const std::string& public_pem);
};

}  // namespace myograde::server
