#include "server/store/record_backfill.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "server/store/record_appender.h"
#include "server/store/record_entries.h"

namespace myograde::server {
namespace {

constexpr size_t kEntriesAtOnce = 5000;
constexpr char kDone[] = "done";

// A row's place in the order of entries: its time, the place of its source, its number.
using EntryPlace = std::tuple<int64_t, int64_t, int64_t>;

// What the last committed transaction reached; "": none was.
std::string ReadMark(SQLite::Database& db) {
  SQLite::Statement select(
      db, "SELECT CAST(value AS TEXT) FROM meta WHERE key = 'record_backfill'");
  return select.executeStep() ? select.getColumn(0).getString() : "";
}

void WriteMark(SQLite::Database& db, const std::string& mark) {
  SQLite::Statement set(db, "INSERT INTO meta VALUES ('record_backfill', CAST(? AS BLOB)) "
                            "ON CONFLICT (key) DO UPDATE SET value = excluded.value");
  set.bind(1, mark);
  set.exec();
}

std::string MarkOf(const EntryPlace& place) {
  const auto& [at, source, row] = place;
  return absl::StrCat(at, "/", source, "/", row);
}

EntryPlace PlaceOf(const std::string& mark) {
  const std::vector<std::string> parts = absl::StrSplit(mark, '/');
  EntryPlace place = {INT64_MIN, 0, 0};
  auto& [at, source, row] = place;
  const bool read = parts.size() == 3 && absl::SimpleAtoi(parts[0], &at) &&
                    absl::SimpleAtoi(parts[1], &source) && absl::SimpleAtoi(parts[2], &row);
  return read ? place : EntryPlace{INT64_MIN, 0, 0};
}

std::vector<EntryPlace> PlacesAfter(SQLite::Database& db, const EntryPlace& last) {
  std::vector<EntryPlace> places;
  int64_t number = 0;
  for (const EntrySource& source : EntrySources()) {
    SQLite::Statement select(db, source.rows);
    while (select.executeStep()) {
      const EntryPlace place = {select.getColumn(0).getInt64(), number,
                           select.getColumn(1).getInt64()};
      if (place > last) places.push_back(place);
    }
    ++number;
  }
  std::sort(places.begin(), places.end());
  return places;
}

void AppendChunk(SQLite::Database& db, std::span<const EntryPlace> places) {
  SQLite::Transaction transaction(db, SQLite::TransactionBehavior::IMMEDIATE);
  RecordAppender appender(db);
  for (const auto& [at, source, row] : places) {
    const EntrySource& from = EntrySources()[static_cast<size_t>(source)];
    std::optional<RecordEntry> entry = MakeEntry(db, from, row);
    if (!entry.has_value()) continue;
    entry->content["backfilled"] = true;
    appender.Append(from.kind, *entry);
  }
  WriteMark(db, MarkOf(places.back()));
  transaction.commit();
}

}  // namespace

void BackfillRecord(SQLite::Database& db) {
  const std::string mark = ReadMark(db);
  if (mark == kDone) return;
  const std::vector<EntryPlace> places = PlacesAfter(db, PlaceOf(mark));
  for (std::span<const EntryPlace> rest = places; !rest.empty();) {
    const std::span<const EntryPlace> chunk = rest.first(std::min(rest.size(), kEntriesAtOnce));
    AppendChunk(db, chunk);
    rest = rest.subspan(chunk.size());
  }
  WriteMark(db, kDone);
}

}  // namespace myograde::server
