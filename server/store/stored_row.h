// Reads one row: each column has the type and range that the schema gives it, or the row is
// damaged. Only the daemon writes the store, but disks fail and people edit. Internal to the store.
//
//   constexpr StoredRows<BlockRow> kBlocks = {
//       "block", "SELECT id, first, state FROM block ", [](StoredRow& row, BlockRow& block) {
//         block.id = row.Id(0);
//         block.first = row.Number(1, 0, kMaxEpisodes);
//         block.state = row.Named<BlockState>(2);
//       }};
//   return kBlocks.All(db_, "WHERE evaluation = ? ORDER BY first", evaluation);
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>
#include <nlohmann/json.hpp>

#include "server/base/enum_names.h"
#include "server/store/damage.h"
#include "server/store/statement.h"

namespace myograde::server {

// More than any count can be.
inline constexpr int64_t kMany = int64_t{1} << 40;

// A column's value for people, for keys and errors.
std::string Shown(const SQLite::Column& column);

class StoredRow {
 public:
  // `select` is positioned on the row and outlives this object. Table and key appear in errors.
  StoredRow(SQLite::Statement& select, std::string table, std::string key);
  // The first column is the key.
  StoredRow(SQLite::Statement& select, std::string table);

  // The following columns belong to another, joined row. NULL in `key_column`: it is missing.
  void Joined(std::string table, int key_column);

  bool IsNull(int column) const { return select_.isColumnNull(column); }
  // Values; after the first error, harmless values of the same type.
  int64_t Number(int column, int64_t min, int64_t max);
  int64_t NumberOr(int column, int64_t min, int64_t max, int64_t if_null);
  int64_t Id(int column) { return Number(column, 1, INT64_MAX); }
  int64_t Time(int column);     // ms since 1970, up to the year 9999
  int64_t TimeOr0(int column);  // 0 if it is NULL
  std::string Blob(int column);  // bytes
  bool Flag(int column) { return Number(column, 0, 1) != 0; }
  std::string Text(int column);    // valid UTF-8
  std::string TextOr(int column);  // "" if it is NULL
  // Texts of this column and those after it.
  void TextsInto(int first_column, std::initializer_list<std::string*> texts);
  std::string Hash(int column);    // 64 lower-case hexadecimal digits
  std::string Object(int column);  // the text of a JSON object
  // The value that the text of a JSON has; `what` it must be is said in the error.
  template <typename Value>
  Value Parsed(int column, const char* what) {
    try {
      return nlohmann::json::parse(Text(column)).template get<Value>();
    } catch (const nlohmann::json::exception&) {
      Fail(column, absl::StrCat("a JSON ", what, " belongs there"));
      return {};
    }
  }

  // One of a few names.
  std::string OneOf(int column, std::initializer_list<std::string_view> names);
  // `parse` returns nullopt for an unknown name.
  template <typename Value>
  Value Named(int column, std::optional<Value> (*parse)(std::string_view) = ParseEnum<Value>) {
    const std::string name = Text(column);
    if (!ok()) return Value{};
    const std::optional<Value> value = parse(name);
    if (!value) Fail(column, "no such name is known");
    return value.value_or(Value{});
  }

  // Reports an error that the caller found, as `its "COLUMN" is VALUE: PROBLEM`.
  void Fail(int column, std::string_view problem);
  // The same, about the whole row.
  void Fail(std::string what);

  bool ok() const { return !damage_.has_value(); }
  const std::optional<Damage>& damage() const { return damage_; }
  absl::Status status() const;

 private:
  SQLite::Statement& select_;
  std::string table_;
  std::string key_;
  bool joined_ = false;
  std::optional<Damage> damage_;
};

// The rows of a table as structs. Each query takes the end of the SELECT, from its WHERE or JOIN on,
// and the values of its parameters.
template <typename Row>
struct StoredRows {
  const char* table;
  const char* select;  // the key comes first
  void (*read)(StoredRow& from, Row& row);
  int key_columns = 1;

  // The row that `query` is positioned on.
  StoredRow Read(SQLite::Statement& query, Row& row) const {
    std::string key = Shown(query.getColumn(0));
    for (int i = 1; i < key_columns; ++i) absl::StrAppend(&key, "/", Shown(query.getColumn(i)));
    StoredRow from(query, table, std::move(key));
    read(from, row);
    return from;
  }

  // All rows, or the damage of the first unreadable one.
  template <typename... Values>
  absl::StatusOr<std::vector<Row>> All(SQLite::Database& db, const std::string& end,
                                       const Values&... values) const {
    Statement query(db, absl::StrCat(select, end), values...);
    std::vector<Row> rows;
    while (query.executeStep()) {
      const StoredRow from = Read(query, rows.emplace_back());
      if (!from.ok()) return from.status();
    }
    return rows;
  }

  // The rows without those that can't be read.
  template <typename... Values>
  Listed<Row> List(SQLite::Database& db, const std::string& end, const Values&... values) const {
    Statement query(db, absl::StrCat(select, end), values...);
    Listed<Row> listed;
    while (query.executeStep()) {
      listed.last_id = query.getColumn(0).getInt64();
      Row row;
      const StoredRow from = Read(query, row);
      if (from.ok()) {
        listed.rows.push_back(std::move(row));
      } else {
        ReportLeftOut(*from.damage());
        listed.damaged.push_back(*from.damage());
      }
    }
    return listed;
  }

  // The first row, or its damage; `missing` if there is none.
  template <typename... Values>
  absl::StatusOr<Row> First(SQLite::Database& db, const absl::Status& missing,
                            const std::string& end, const Values&... values) const {
    Statement query(db, absl::StrCat(select, end), values...);
    if (!query.executeStep()) return missing;
    Row row;
    const StoredRow from = Read(query, row);
    if (!from.ok()) return from.status();
    return row;
  }
};

}  // namespace myograde::server
