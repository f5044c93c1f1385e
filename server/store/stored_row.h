// SQLite statements in one call each, and rows as structs, whose members are the columns of a query
// in their order. A row with a value that its member can't have is damaged: only the daemon writes
// the store, but disks fail and people edit. What else the schema says of a row is checked when the store is opened (connection.h), and
// here where nothing may follow from a row that breaks it. Internal to the store.
//
//   constexpr StoredRows<BlockRow, 3> kBlocks = {"block", "SELECT id, first, state FROM block "};
//   return kBlocks.All(db_, "WHERE evaluation = ? ORDER BY first", evaluation);
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>
#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/outcome.h"
#include "protocol/lease/policy_image.h"
#include "server/base/enum_names.h"
#include "server/store/damage.h"

namespace myograde::server {

// --- statements; everything here throws SQLite::Exception ---

// What SQLite::bind takes: it knows no views.
inline std::string Bindable(std::string_view text) { return std::string(text); }
template <typename Value>
const Value& Bindable(const Value& value) {
  return value;
}

// A statement with the values of its parameters, the first ones first.
class Statement : public SQLite::Statement {
 public:
  template <typename... Values>
  explicit Statement(SQLite::Database& db, const std::string& sql, const Values&... values)
      : SQLite::Statement(db, sql) {
    SQLite::bind(*this, Bindable(values)...);
  }
};

// Runs a change; the number of rows that it changed.
template <typename... Values>
int Run(SQLite::Database& db, const std::string& sql, const Values&... values) {
  return Statement(db, sql, values...).exec();
}

// Whether a query gives any row.
template <typename... Values>
bool AnyRow(SQLite::Database& db, const std::string& sql, const Values&... values) {
  return Statement(db, sql, values...).executeStep();
}

template <typename Value>
Value NextValue(SQLite::Statement& select, int& column) {
  return select.getColumn(column++);
}

// The first columns of the first row, whole numbers and texts; 0 and "" if there is no row.
template <typename... Columns, typename... Values>
std::tuple<Columns...> FirstRow(SQLite::Database& db, const std::string& sql,
                                const Values&... values) {
  Statement select(db, sql, values...);
  if (!select.executeStep()) return {};
  int column = 0;
  return {NextValue<Columns>(select, column)...};  // in their order, as these are braces
}

// The same of one column.
template <typename Value, typename... Values>
Value FirstValue(SQLite::Database& db, const std::string& sql, const Values&... values) {
  return std::get<0>(FirstRow<Value>(db, sql, values...));
}

// The first column of every row, as a list or a set.
template <typename Value, typename All = std::vector<Value>, typename... Values>
All AllValues(SQLite::Database& db, const std::string& sql, const Values&... values) {
  Statement select(db, sql, values...);
  All all;
  while (select.executeStep()) all.insert(all.end(), Value(select.getColumn(0)));
  return all;
}

// --- rows as structs ---

// A column's value for people, for keys and errors.
std::string Shown(const SQLite::Column& column);

// A column of the row that a query is positioned on, as whatever its member is. Conversions throw a
// BadColumn; NULL is only an optional's value.
struct BadColumn {
  std::string what;  // `its "COLUMN" is VALUE: PROBLEM`
};
class StoredColumn {
 public:
  StoredColumn(SQLite::Statement& select, int column) : value_(select.getColumn(column)) {}

  // NOLINTBEGIN(google-explicit-constructor): a member is initialized by it
  operator int64_t() const;      // from 0 to 2^53: no id, count or time is larger
  operator uint64_t() const;     // from 0 to 2^63 - 1: a seed
  operator double() const;       // stored as thousandths
  operator std::optional<double>() &&;  // the same
  operator bool() const;
  operator std::string() const;  // UTF-8; the text of a JSON object where the column is a *_json
  operator std::vector<std::string>() const;  // stored as JSON
  operator PolicyManifest() const;            // the same
  operator Outcome() const;
  operator FailureReason() const;
  template <typename Value>
    requires std::is_enum_v<Value>
  operator Value() const {
    return Named<Value>(ParseEnum<Value>);
  }
  // NOLINTEND(google-explicit-constructor)

 private:
  [[noreturn]] void Fail(std::string_view problem) const;
  int64_t NumberTo(int64_t max) const;
  std::string Text() const;
  template <typename Value>
  Value Named(std::optional<Value> (*parse)(std::string_view)) const {
    const std::optional<Value> value = parse(Text());
    if (!value) Fail("no such name is known");
    return *value;
  }

  SQLite::Column value_;
};

// The rows of a table. Each query takes the end of the SELECT, from its WHERE or JOIN on, and the
// values of its parameters.
template <typename Row, int kColumns>
struct StoredRows {
  const char* table;
  const char* select;                        // the key comes first
  int key_columns = 1;
  int first = 0;                             // the column of the first member
  const char* (*wrong)(const Row&) = nullptr;  // what is wrong with the whole; "": nothing

  // The row that `query` is positioned on, or its damage.
  absl::StatusOr<Row> Read(SQLite::Statement& query) const {
    std::string what;
    try {
      Row row = Make(query, std::make_integer_sequence<int, kColumns>());
      what = wrong == nullptr ? "" : wrong(row);
      if (what.empty()) return row;
    } catch (const BadColumn& bad) {
      what = bad.what;
    }
    std::string key = Shown(query.getColumn(0));
    for (int i = 1; i < key_columns; ++i) absl::StrAppend(&key, "/", Shown(query.getColumn(i)));
    return DamagedRow({table, std::move(key), std::move(what)});
  }

  // All rows, or the damage of the first unreadable one.
  template <typename... Values>
  absl::StatusOr<std::vector<Row>> All(SQLite::Database& db, const std::string& end,
                                       const Values&... values) const {
    Statement query(db, absl::StrCat(select, end), values...);
    std::vector<Row> rows;
    while (query.executeStep()) {
      absl::StatusOr<Row> row = Read(query);
      if (!row.ok()) return row.status();
      rows.push_back(*std::move(row));
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
      absl::StatusOr<Row> row = Read(query);
      if (IsLeftOut(row.status())) {
        listed.damaged.push_back(*ExtractDamage(row.status()));
      } else {
        listed.rows.push_back(*std::move(row));
      }
    }
    return listed;
  }

  // The first row, or its damage; `missing` if there is none.
  template <typename... Values>
  absl::StatusOr<Row> First(SQLite::Database& db, const absl::Status& missing,
                            const std::string& end, const Values&... values) const {
    Statement query(db, absl::StrCat(select, end), values...);
    return query.executeStep() ? Read(query) : missing;
  }

 private:
  template <int... I>
  Row Make(SQLite::Statement& query, std::integer_sequence<int, I...>) const {
    return Row{StoredColumn(query, first + I)...};
  }
};

}  // namespace myograde::server
