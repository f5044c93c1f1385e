#include "server/store/transfer.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <SQLiteCpp/SQLiteCpp.h>
#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "protocol/base/status_macros.h"
#include "server/base/json_value.h"
#include "server/store/connection.h"
#include "server/store/store.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr char kFormat[] = "myograde-export";
constexpr char kHead[] = "{\"data\":{";
constexpr size_t kMaxLine = 8u << 20;
constexpr size_t kMaxTables = 64;
// Rows that are added later need larger ids, and JSON's readers know no larger number exactly.
constexpr int64_t kMaxId = int64_t{1} << 53;
constexpr char kBytes[] = "bytes";  // the key of a value that is neither text nor a whole number
// Left out: secrets, tokens, the keys of requests, denials and acts (they are this daemon's), the
// views, the uploads (their files are on this host), what this daemon's webhooks are told, and
// SQLite's own tables.
constexpr char kExportedTables[] =
    "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' AND "
    "name NOT IN ('meta', 'standing', 'team_skeleton', 'upload', 'artefact_holder', "
    "'phase_secret', 'token', 'request_key', 'access_event', 'delivery') ORDER BY name";

struct Table {
  std::string name;
  std::vector<std::string> columns;  // sorted
  std::vector<std::string> key;      // of the primary key, in key order
};

// By name.
std::map<std::string, Table> BuildTables(SQLite::Database& db) {
  std::map<std::string, Table> tables;
  for (const std::string& name : AllValues<std::string>(db, kExportedTables)) {
    const auto columns = [&](const char* which) {
      return AllValues<std::string>(
          db, absl::StrCat("SELECT name FROM pragma_table_info(?) ", which), name);
    };
    tables[name] = {name, columns("ORDER BY name"), columns("WHERE pk > 0 ORDER BY pk")};
  }
  return tables;
}

std::string Quoted(const std::vector<std::string>& names) {
  return absl::StrCat("\"", absl::StrJoin(names, "\", \""), "\"");
}

// A type that the schema never allows comes from a damaged row and is written as its bytes.
Json ValueOf(const SQLite::Column& column) {
  if (column.isNull()) return Json();
  if (column.isInteger()) return Json(column.getInt64());
  const std::string bytes = column.getString();
  try {
    const Json text = bytes;
    if (column.isText() && !text.dump().empty()) return text;
  } catch (const Json::exception&) {  // not UTF-8
  }
  return {{kBytes, absl::BytesToHexString(bytes)}};
}

// `select` reads the table's columns, in their order.
Json RowOf(SQLite::Statement& select, const Table& table) {
  Json row = Json::object();
  for (size_t i = 0; i < table.columns.size(); ++i) {
    row[table.columns[i]] = ValueOf(select.getColumn(static_cast<int>(i)));
  }
  return row;
}

absl::Status Broken(const std::string& path, int64_t line, std::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": line ", line, ": ", std::string(what),
                   "; it is not an export, or it was changed or cut off: export again"));
}

std::string Shown(const Json& value) {
  return value.dump(-1, ' ', false, Json::error_handler_t::replace).substr(0, 120);
}

absl::Status RefusedRow(const Table& table, const Json& row, std::string_view why) {
  std::vector<std::string> key;
  for (const std::string& column : table.key) key.push_back(Shown(row.value(column, Json())));
  return absl::InvalidArgumentError(absl::StrCat("row ", absl::StrJoin(key, "/"), " of the table ",
                                                 table.name, " ", std::string(why), ": ", Shown(row)));
}

// Prepares one INSERT per table.
class Inserter {
 public:
  explicit Inserter(SQLite::Database& db) : tables_(BuildTables(db)) {
    for (const auto& [name, table] : tables_) {
      std::vector<std::string> marks(table.columns.size(), "?");
      const std::string sql = absl::StrCat("INSERT INTO \"", name, "\" (", Quoted(table.columns),
                                           ") VALUES (", absl::StrJoin(marks, ", "), ")");
      statements_[name] = std::make_unique<SQLite::Statement>(db, sql);
    }
  }

  absl::Status CheckTables(const ExportInfo& info) const {
    const auto first = [](const auto& left, const auto& right) { return left.first == right.first; };
    if (std::ranges::equal(info.rows, tables_, first)) return absl::OkStatus();
    const auto name = [](std::string* text, const auto& table) { text->append(table.first); };
    return absl::InvalidArgumentError(
        absl::StrCat("the export has other tables (", absl::StrJoin(info.rows, ", ", name),
                     ") than a store (", absl::StrJoin(tables_, ", ", name), ")"));
  }

  absl::Status Insert(const std::string& name, const Json& row) {
    const Table& table = tables_.at(name);
    SQLite::Statement& insert = *statements_.at(name);
    insert.reset();
    bool fits = row.size() == table.columns.size();
    auto expected = table.columns.begin();
    int place = 1;
    for (auto value = row.begin(); fits && value != row.end(); ++value, ++expected, ++place) {
      fits = value.key() == *expected;
      // Larger numbers would be stored as negative ones.
      const bool number = value->is_number_unsigned()
                              ? value->get<uint64_t>() <= uint64_t{INT64_MAX}
                              : value->is_number_integer();
      if (value->is_string()) {
        insert.bind(place, value->get<std::string>());
      } else if (number) {
        insert.bind(place, value->get<int64_t>());
      } else if (value->is_null()) {
        insert.bind(place);
      } else {
        fits = false;
      }
    }
    const auto refused = [&](std::string_view why) { return RefusedRow(table, row, why); };
    if (!fits) return refused("has other columns or values than a store");
    for (const std::string& column : table.key) {
      const Json& id = row[column];
      if (id.is_number() && id > kMaxId) return refused(absl::StrCat("has a \"", column, "\" over 2^53"));
    }
    // Files are looked up by these.
    for (const char* column : {"hash", "artefact"}) {
      const auto hash = row.find(column);
      if (hash != row.end() && !(hash->is_string() && IsSha256Hex(hash->get<std::string>()))) {
        return refused(absl::StrCat("has as its \"", column,
                                    "\" not 64 lower-case hexadecimal digits"));
      }
    }
    try {
      insert.exec();
    } catch (const SQLite::Exception& error) {
      const absl::Status status = StatusOf("the store", error);
      if (!absl::IsFailedPrecondition(status)) throw;
      return refused(absl::StrCat("is refused (SQLite: ", error.what(), ")"));
    }
    return absl::OkStatus();
  }

 private:
  const std::map<std::string, Table> tables_;
  std::map<std::string, std::unique_ptr<SQLite::Statement>> statements_;
};

// Whether every row that another one names is there. The commit would only say that one is not.
absl::Status CheckReferences(SQLite::Database& db) {
  const auto [child, parent, names, same] =
      FirstRow<std::string, std::string, std::string, std::string>(db, R"(
      SELECT c."table", c.parent, group_concat('c."' || l."from" || '" IS NOT NULL', ' AND '),
             group_concat('p."' || l."to" || '" = c."' || l."from" || '"', ' AND ')
      FROM (SELECT * FROM pragma_foreign_key_check LIMIT 1) AS c
      JOIN pragma_foreign_key_list(c."table") AS l ON l.id = c.fkid)");
  if (child.empty()) return absl::OkStatus();
  const Table table = BuildTables(db).at(child);
  // Not by its rowid, which some tables don't have.
  Statement select(
      db, absl::StrCat("SELECT ", Quoted(table.columns), " FROM \"", child, "\" AS c WHERE ", names,
                       " AND NOT EXISTS (SELECT 1 FROM \"", parent, "\" AS p WHERE ", same, ")"));
  const Json row = select.executeStep() ? RowOf(select, table) : Json::object();
  return RefusedRow(table, row, absl::StrCat("names a row of the table ", parent, " that is not there"));
}

// The row in a line of an export.
absl::StatusOr<Json> ParseRow(const std::string& path, std::string_view text, int64_t number) {
  Json row = ParsedText(text);
  if (!row.is_object()) return Broken(path, number, "is not a JSON object");
  for (const Json& value : row) {
    const bool bytes = value.is_object() && value.size() == 1 && value.contains(kBytes) &&
                       value[kBytes].is_string();
    if (value.is_structured() && !bytes) {
      return Broken(path, number, "is not a row of plain values");
    }
  }
  return row;
}

}  // namespace

absl::Status ExportRows(SQLite::Database& db, const ExportSink& sink) {
  Sha256 hash;
  const auto write = [&](const std::string& text) {
    hash.Update(text);
    return sink(text) ? absl::OkStatus() : absl::CancelledError("the export was stopped");
  };
  RETURN_IF_ERROR(write(kHead));
  const char* comma = "";
  for (const auto& [name, table] : BuildTables(db)) {
    RETURN_IF_ERROR(write(absl::StrCat(std::exchange(comma, ","), "\n\"", name, "\":[")));
    Statement select(
        db, absl::StrCat("SELECT ", Quoted(table.columns), " FROM \"", name, "\" ORDER BY ",
                         table.key.empty() ? "rowid" : Quoted(table.key)));
    for (bool more = false; select.executeStep(); more = true) {
      RETURN_IF_ERROR(
          write(absl::StrCat(more ? ",\n" : "\n", CanonicalJson(RowOf(select, table)))));
    }
    RETURN_IF_ERROR(write("\n]"));
  }
  RETURN_IF_ERROR(write(
      absl::StrCat("\n},\"format\":\"", kFormat, "\",\"schema\":", SchemaVersion())));
  return write(absl::StrCat(",\"sha256\":\"", hash.FinishHex(), "\"}\n"));
}

absl::StatusOr<ExportInfo> CheckExport(const std::string& path, const RowSink& on_row) {
  ExportInfo info;
  Sha256 hash;
  std::string table;  // whose rows are being read; "": none
  std::string last;
  int64_t lines = 0;
  ASSIGN_OR_RETURN(const Fd file, OpenToRead(path));
  const auto on_line = [&](std::string_view line, int64_t number) -> absl::Status {
    lines = number;
    if (!last.empty()) return Broken(path, number, "comes after the end");
    if (line.starts_with("},\"format\":")) {
      last = std::string(line);
      return absl::OkStatus();
    }
    hash.Update(line);
    hash.Update("\n");
    if (number == 1) {
      return line == kHead ? absl::OkStatus()
                           : Broken(path, 1, "is not the beginning of an export");
    }
    if (line.ends_with(',')) line.remove_suffix(1);
    if (!table.empty() && line.starts_with('{')) {
      ++info.rows[table];
      if (on_row == nullptr) return absl::OkStatus();
      ASSIGN_OR_RETURN(const Json row, ParseRow(path, line, number));
      return on_row(table, row);
    }
    if (!table.empty() && line == "]") {
      table.clear();
      return absl::OkStatus();
    }
    if (!table.empty() || !line.starts_with('"') || !line.ends_with("\":[") || line.size() <= 4) {
      return Broken(path, number, "is not what an export has there");
    }
    table = std::string(line.substr(1, line.size() - 4));
    info.rows.try_emplace(table, 0);
    return info.rows.size() <= kMaxTables ? absl::OkStatus()
                                          : Broken(path, number, "is one table too many");
  };
  RETURN_IF_ERROR(ForEachLine(file.get(), path, kMaxLine, on_line));
  const size_t digest = last.find(",\"sha256\":");
  const Json trailer =
      last.empty() ? Json() : ParseJson("{" + last.substr(2), path).value_or(Json());
  if (digest == std::string::npos || !table.empty() || !trailer.is_object() ||
      trailer.value("format", Json()) != kFormat || !trailer.value("sha256", Json()).is_string() ||
      !trailer.value("schema", Json()).is_number_unsigned()) {
    return Broken(path, lines, "is the last, and an export has its checksum there");
  }
  hash.Update(std::string_view(last).substr(0, digest));
  info.schema = trailer["schema"].get<int64_t>();
  info.sha256 = trailer["sha256"].get<std::string>();
  if (const std::string found = hash.FinishHex(); found != info.sha256) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": has the checksum ", found, " and says ", info.sha256,
                     ": it was changed after it was written; export again"));
  }
  return info;
}

absl::Status ImportRows(SQLite::Database& db, const std::string& path, const ExportInfo& info) {
  if (info.schema != SchemaVersion()) {
    return absl::FailedPreconditionError(
        absl::StrCat(path, ": is of schema ", info.schema, ", this program's is ",
                     SchemaVersion(), "; export and import with the same version"));
  }
  for (const auto& [name, table] : BuildTables(db)) {
    if (AnyRow(db, absl::StrCat("SELECT 1 FROM \"", name, "\" LIMIT 1"))) {
      return absl::FailedPreconditionError(
          absl::StrCat("the store has rows already (table ", name,
                       "); an export can be imported only into an empty store: give --data a new "
                       "folder"));
    }
  }
  Inserter inserter(db);
  RETURN_IF_ERROR(inserter.CheckTables(info));
  db.exec("PRAGMA defer_foreign_keys = ON");  // until the transaction ends
  const absl::StatusOr<ExportInfo> inserted =
      CheckExport(path, [&](const std::string& table, const Json& row) {
        return inserter.Insert(table, row);
      });
  return inserted.ok() ? CheckReferences(db) : inserted.status();
}

}  // namespace myograde::server
