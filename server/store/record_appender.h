// Adds entries at the end of the public record. Internal to the store; throws SQLite::Exception.
#pragma once

#include <cstdint>
#include <string>

#include "server/store/connection.h"
#include "server/store/record_entries.h"

namespace myograde::server {

// Only inside a transaction, in which nothing else appends. A disk's fault or a stranger's edit of
// the last row does not keep what follows out: the chain goes on from what is there, and a check of
// the chain tells where it broke.
class RecordAppender {
 public:
  explicit RecordAppender(SQLite::Database& db);

  void Append(const std::string& kind, const RecordEntry& entry);

 private:
  SQLite::Statement insert_;
  int64_t next_ = 0;   // index
  std::string chain_;  // of the entry before; "": there is none
};

// Adds the entry of a row, if it has one. REQUIRES: there are entries of this kind (record.h).
void AppendEntry(SQLite::Database& db, const std::string& kind, int64_t row);

}  // namespace myograde::server
