// SQLite statements in one call each. Internal to the store; everything here throws
// SQLite::Exception.
#pragma once

#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <SQLiteCpp/VariadicBind.h>

namespace myograde::server {

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

// The first column of every row.
template <typename Value, typename... Values>
std::vector<Value> AllValues(SQLite::Database& db, const std::string& sql,
                             const Values&... values) {
  Statement select(db, sql, values...);
  std::vector<Value> all;
  while (select.executeStep()) all.push_back(select.getColumn(0));
  return all;
}

}  // namespace myograde::server
