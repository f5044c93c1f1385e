// Makes the entries of the public record from the store's rows. Internal to the store; everything
// here throws SQLite::Exception.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include <nlohmann/json.hpp>

#include "server/store/connection.h"
#include "server/store/record.h"

namespace myograde::server {

struct RecordEntry {
  int64_t at = 0;          // ms since 1970
  int64_t evaluation = 0;  // that it is about; 0: none
  nlohmann::json content;
};

// Where entries of one kind come from.
struct EntrySource {
  const char* kind;
  const char* rows;  // SELECT at, id of all rows that may have an entry
  std::optional<RecordEntry> (*make)(SQLite::Database& db, int64_t row);
};

// In the order in which rows of the same time get their entries.
std::span<const EntrySource> EntrySources();

// The entry of a row; nullopt: it has none. An unreadable row has one that says so.
std::optional<RecordEntry> MakeEntry(SQLite::Database& db, const EntrySource& source, int64_t row);
RecordEntry MakeKeyEntry(int64_t at, const std::string& public_pem);

}  // namespace myograde::server
