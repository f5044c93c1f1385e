#include "server/api/record_log.h"

#include <utility>

#include <absl/strings/str_cat.h>

#include "server/store/journal.h"

namespace myograde::server {
namespace {

constexpr size_t kMostDamage = 10;

absl::Status OutOfRange(const char* name, int64_t value, int64_t least, int64_t most) {
  return absl::InvalidArgumentError(absl::StrCat("\"", name, "\" is ", value, "; the record allows ",
                                                 least, " to ", most, " there"));
}

}  // namespace

void RecordLog::Follow(const Transaction& reader) {
  reader.journal.ForEachEntry(
      tree_.size(), chain_,
      [&](const RecordRow* row, std::optional<Damage> damage) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
        if (damage.has_value() && damaged_.size() < kMostDamage) {
          damaged_.push_back(*std::move(damage));
        }
        tree_.Append(row == nullptr ? "" : row->entry_json);
        chain_ = row == nullptr ? "" : row->chain;
        return true;
      });
}

std::vector<Damage> RecordLog::Damaged(const Transaction& reader) {
  const MutexLock lock(mutex_);
  Follow(reader);
  return damaged_;
}

absl::StatusOr<RecordHead> RecordLog::Head(const Transaction& reader) {
  const MutexLock lock(mutex_);
  Follow(reader);
  RecordHead head;
  head.size = reader.journal.RecordSize();
  head.root = tree_.Root(head.size);
  if (head.size == 0) return head;
  const Listed<RecordRow> last = reader.journal.Record(head.size - 1, 1);
  if (!last.damaged.empty()) return DamagedRow(last.damaged.front());
  if (!last.rows.empty()) head.chain = last.rows.front().chain;
  return head;
}

absl::StatusOr<EntryProof> RecordLog::Prove(const Transaction& reader, int64_t entry,
                                            int64_t size) {
  const int64_t whole = reader.journal.RecordSize();
  if (size == 0) size = whole;
  if (entry < 0 || entry >= whole) return OutOfRange("entry", entry, 0, whole - 1);
  if (size <= entry || size > whole) return OutOfRange("size", size, entry + 1, whole);
  const Listed<RecordRow> row = reader.journal.Record(entry, 1);
  if (!row.damaged.empty()) return DamagedRow(row.damaged.front());
  if (row.rows.empty() || row.rows.front().index != entry) {
    return DamagedRow({"record", absl::StrCat(entry), "it is gone"});
  }
  const MutexLock lock(mutex_);
  Follow(reader);
  return EntryProof{.index = entry,
                    .content = nlohmann::json::parse(row.rows.front().entry_json),
                    .size = size,
                    .root = tree_.Root(size),
                    .proof = tree_.InclusionProof(entry, size)};
}

absl::StatusOr<RecordLog::Consistency> RecordLog::Compare(const Transaction& reader, int64_t from,
                                                          int64_t to) {
  const int64_t whole = reader.journal.RecordSize();
  if (to == 0) to = whole;
  if (to < 0 || to > whole) return OutOfRange("to", to, 0, whole);
  if (from < 0 || from > to) return OutOfRange("from", from, 0, to);
  const MutexLock lock(mutex_);
  Follow(reader);
  return Consistency{tree_.Root(from), tree_.Root(to), tree_.ConsistencyProof(from, to)};
}

}  // namespace myograde::server
