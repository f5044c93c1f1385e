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

constexpr int64_t kMsOfADay = 24 * 60 * 60 * 1000;

// Adds to the count of the day's row of equal denials. False: there is none.
bool CountDenial(SQLite::Database& db, const AccessEventRow& event, int64_t now_ms) {
  SQLite::Statement update(
      db, "UPDATE access_event SET count = count + ?1 WHERE id = (SELECT id FROM access_event "
          "WHERE kind = 'denied' AND at BETWEEN ?2 AND ?3 AND who = ?4 AND role = ?5 AND action = ?6 "
          "AND subject = ?7 AND detail = ?8 LIMIT 1)");
  const int64_t day = now_ms / kMsOfADay * kMsOfADay;
  SQLite::bind(update, event.count, day, day + kMsOfADay - 1, event.who, event.role, event.action,
               event.subject, event.detail);
  return update.exec() > 0;
}

bool IsDayFull(SQLite::Database& db, int64_t now_ms) {
  SQLite::Statement select(db, "SELECT count(*) FROM (SELECT 1 FROM access_event WHERE "
                               "kind = 'denied' AND at BETWEEN ? AND ? LIMIT ?)");
  const int64_t day = now_ms / kMsOfADay * kMsOfADay;
  SQLite::bind(select, day, day + kMsOfADay - 1, kMostDenialsOfADay);
  select.executeStep();
  return select.getColumn(0).getInt64() == kMostDenialsOfADay;
}

}  // namespace

absl::Status Writer::AddDenial(AccessEventRow event, const AccessEventRow& others) {
  event.kind = "denied";
  if (CountDenial(db_, event, now_ms_)) return absl::OkStatus();
  if (IsDayFull(db_, now_ms_)) {
    const int64_t count = event.count;
    event = others;
    event.kind = "denied";
    event.count = count;
    if (CountDenial(db_, event, now_ms_)) return absl::OkStatus();
  }
  return AddAccessEvent(event);
}

void Writer::RemoveDenials(int64_t before_ms) {
  SQLite::Statement remove(db_, "DELETE FROM access_event WHERE id IN (SELECT id FROM access_event "
                                "WHERE kind = 'denied' AND at < ? ORDER BY at LIMIT 10000)");
  remove.bind(1, before_ms);
  remove.exec();
}

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
