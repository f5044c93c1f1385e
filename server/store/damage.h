// What is wrong when the store can't be read, in kinds that callers treat apart:
//
//   trouble that may pass   another process holds it, the disk is full: the same can succeed later
//   a damaged row           whatever needs that row can't be had, and everything else can
//   a broken store          the database file itself: nothing of it is to be trusted
//
// Everything else (NotFoundError, FailedPreconditionError, ...) is about the request.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <absl/status/status.h>

namespace myograde::server {

// The code of a damaged row in answers (ErrorCodeOf of quota.h).
inline constexpr char kDamagedRowCode[] = "damaged_row";

// A row that can't be read, or that is missing though another one names it.
struct Damage {
  std::string table;
  std::string key;   // its primary key; the parts of one that has several are joined by "/"
  std::string what;  // what is wrong with it, as the rest of the sentence: `its "state" is ...`
};

// "evaluation 7 of the store can't be read: ...".
std::string DamageText(const Damage& damage);

absl::Status DamagedRow(const Damage& damage);
// nullopt: the status is of another kind.
std::optional<Damage> DamageOf(const absl::Status& status);

bool MayPass(const absl::Status& status);
bool IsBrokenStore(const absl::Status& status);

// What of a list can be read, and what can't.
template <typename Row>
struct Listed {
  std::vector<Row> rows;
  std::vector<Damage> damaged;
  int64_t last_id = 0;  // of all these, where they have one
};

}  // namespace myograde::server
