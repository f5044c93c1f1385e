// All that may leave a store, as one canonical JSON document: equal rows give equal bytes. One row
// per line, so that files of any length are written and read in pieces:
//
//   {"data":{
//   "artefact":[
//   {"bytes":20058,...},
//   {...}
//   ],
//   "attempt":[
//   ...
//   ]
//   },"format":"myograde-export","schema":1,"sha256":"<64 hexadecimal digits>"}
//
// Tables by name, rows by primary key, keys by name. The digest covers every byte before
// `,"sha256"`. Left out: the store's secret, views that can be rebuilt from the rows, and the
// artefacts' files. A damaged row's value that is neither a whole number nor text is
// {"bytes":"<hexadecimal>"}, which imports reject.
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

// Receives the document's next bytes; returns false to stop the export.
using ExportSink = std::function<bool(std::string_view)>;

// Only inside a transaction, so that everything is of one state. Throws SQLite::Exception;
// CancelledError if the sink stopped it.
absl::Status ExportRows(SQLite::Database& db, const ExportSink& sink);

struct ExportInfo {
  int64_t schema = 0;
  std::string sha256;
  std::map<std::string, int64_t> rows;  // by table
};

// Receives a row of an export; its error ends the reading.
using RowSink = std::function<absl::Status(const std::string& table, const nlohmann::json& row)>;

// Reads a whole document, and passes on each row, in file order; without `on_row`, what is in a row
// is not looked at. InvalidArgumentError names the line: not an export, incomplete, or a wrong
// digest.
absl::StatusOr<ExportInfo> CheckExport(const std::string& path, const RowSink& on_row = nullptr);

// Fills an empty store with the rows of a checked document, inside the caller's transaction.
// FailedPreconditionError: the store is not empty, or the file has another schema.
// InvalidArgumentError: a row was rejected, and is shown.
absl::Status ImportRows(SQLite::Database& db, const std::string& path, const ExportInfo& info);

}  // namespace myograde::server
