// What can be wrong when reading the store, in kinds that callers treat differently:
//
//   trouble that may pass   another process holds it, the disk is full: a retry may succeed
//   a damaged row           whatever needs that row fails, everything else works
//   a broken store          the database file itself: nothing in it can be trusted
//
// Any other error (NotFoundError, FailedPreconditionError, ...) is about the request.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/status.h>

namespace myograde::server {

// A row that is unreadable, or missing though another one names it.
struct Damage {
  std::string table;
  std::string key;   // its primary key; the parts of a composite key are joined by "/"
  std::string what;  // what is wrong, to complete a sentence: `its "state" is ...`

  bool operator==(const Damage&) const = default;
};

// "evaluation 7 of the store can't be read: ...".
std::string DamageText(const Damage& damage);

absl::Status DamagedRow(const Damage& damage);
// nullopt if the status is of another kind.
std::optional<Damage> ExtractDamage(const absl::Status& status);

bool MayPass(const absl::Status& status);
bool IsBrokenStore(const absl::Status& status);
// A broken store of which SQLite found pages that can't be what was written.
bool IsCorruptStore(const absl::Status& status);
absl::Status CorruptStore(const std::string& message);

// Whether it is of a damaged row, which lists leave out; each is logged once.
bool IsLeftOut(const absl::Status& status);

// A list's rows without those that can't be read, which are logged.
template <typename Row>
struct Listed {
  std::vector<Row> rows;
  std::vector<Damage> damaged = {};  // those that can't be read
  int64_t last_id = 0;               // of all these, if they have one

  int64_t found() const { return std::ssize(rows) + std::ssize(damaged); }
};

}  // namespace myograde::server
