#include "server/store/content.h"

#include <absl/strings/str_cat.h>

#include "server/store/connection.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

absl::Status CheckContent(SQLite::Database& db, const char* table, const char* column,
                          const std::string& hash, const std::string& text) {
  SQLite::Statement select(
      db, absl::StrCat("SELECT ", column, " FROM ", table, " WHERE hash = ?"));
  select.bind(1, hash);
  if (select.executeStep() && select.getColumn(0).isText() &&
      select.getColumn(0).getString() == text) {
    return absl::OkStatus();
  }
  return DamagedRow({table, hash, "its content has another hash"});
}

}  // namespace

absl::Status AddConfig(SQLite::Database& db, const std::string& hash, const std::string& track,
                       const std::string& profile, const std::string& json, int64_t now_ms) {
  SQLite::Statement insert(db, "INSERT INTO config VALUES (?, ?, ?, ?, ?) ON CONFLICT DO NOTHING");
  SQLite::bind(insert, hash, track, profile, json, now_ms);
  insert.exec();
  return CheckContent(db, "config", "effective_json", hash, json);
}

absl::Status AddSeedList(SQLite::Database& db, const std::string& hash, int64_t count,
                         const std::string& json) {
  SQLite::Statement insert(db, "INSERT INTO seed_list VALUES (?, ?, ?) ON CONFLICT DO NOTHING");
  SQLite::bind(insert, hash, count, json);
  insert.exec();
  return CheckContent(db, "seed_list", "seeds_json", hash, json);
}

}  // namespace myograde::server
