// Denied requests, and acts of organisers and operators.
#include "server/store/connection.h"
#include "server/store/reader.h"
#include "server/store/store.h"
#include "server/store/stored_row.h"

namespace myograde::server {
namespace {

StoredRow AccessEventOf(SQLite::Statement& select, AccessEventRow& event) {
  StoredRow row(select, "access_event", Shown(select.getColumn(0)));
  event.id = row.Number(0, 1, INT64_MAX);
  event.at = row.Time(1);
  event.kind = row.OneOf(2, {"denied", "act"});
  event.who = row.Text(3);
  event.role = row.Text(4);
  event.action = row.Text(5);
  event.subject = row.Text(6);
  event.detail = row.Text(7);
  event.count = row.Number(8, 1, INT64_MAX);
  return row;
}

}  // namespace

absl::Status Writer::AddAccessEvent(const AccessEventRow& event) {
  SQLite::Statement insert(db_, "INSERT INTO access_event (at, kind, who, role, action, subject, "
                                "detail, count) VALUES (?, ?, ?, ?, ?, ?, ?, ?)");
  SQLite::bind(insert, now_ms_, event.kind, event.who, event.role, event.action, event.subject,
               event.detail, event.count);
  insert.exec();
  return absl::OkStatus();
}

Listed<AccessEventRow> Reader::AccessEvents(const std::string& kind, int64_t before,
                                            int64_t limit) {
  SQLite::Statement select(
      db_, "SELECT id, at, kind, who, role, action, subject, detail, count FROM access_event "
           "WHERE id < ?1 AND (?2 = '' OR kind = ?2) ORDER BY id DESC LIMIT ?3");
  SQLite::bind(select, before, kind, limit);
  return ListOf<AccessEventRow>(select, {}, AccessEventOf);
}

}  // namespace myograde::server
