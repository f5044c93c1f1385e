// Everything of a store that others may have, as one canonical JSON document: the
// same rows give the same bytes. A row is a line, so that files of any length are
// written and read piece by piece:
//
//   {"data":{
//   "admission":[
//   {"budget":"official","day":20058,...},
//   {...}
//   ],
//   "artefact":[
//   ...
//   ]
//   },"format":"myograde-export","schema":2,"sha256":"<64 hexadecimal digits>"}
//
// Tables by name, rows by primary key, keys by name. The digest is over every byte
// before `,"sha256"`. What is left out: the store's secret, the views that are
// made anew of the rows, and the files of the artefacts. A value of a damaged row that is
// neither a whole number nor text is {"bytes":"<hexadecimal>"}, which no import takes.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace SQLite {
class Database;
}

namespace myograde::server {

// Takes the document's next bytes; false stops the export.
using ExportSink = std::function<bool(std::string_view)>;

// Only inside a transaction, so that all is of one state. Throws
// SQLite::Exception; CancelledError if the sink said stop.
absl::Status ExportRows(SQLite::Database& db, const ExportSink& sink);

struct ExportInfo {
  int64_t schema = 0;
  std::string sha256;
  int64_t bytes = 0;
  std::map<std::string, int64_t> rows;  // by table
};

// Reads a whole document. InvalidArgumentError names the line: it is no export,
// it is not whole, or its digest is another.
absl::StatusOr<ExportInfo> CheckExport(const std::string& path);

// Calls `row` for each row, in the file's order. REQUIRES: CheckExport was content.
absl::Status ForEachRow(
    const std::string& path,
    const std::function<absl::Status(const std::string& table, const nlohmann::json& row)>& row);

// Fills an empty store with the rows of a checked document, inside the caller's
// transaction. FailedPreconditionError: the store has rows already, or the file is
// of another schema. InvalidArgumentError: a row is refused, and shown.
absl::Status ImportRows(SQLite::Database& db, const std::string& path, const ExportInfo& info);

}  // namespace myograde::server
