#include "server/api/access_log.h"

#include <iterator>
#include <utility>

#include <spdlog/spdlog.h>

namespace myograde::server {
namespace {

// Acts of organisers that wait for the store; so many can only come together if it takes nothing.
constexpr size_t kMostActs = 10'000;
constexpr size_t kMostTokens = 10'000;
constexpr absl::Duration kWriteEvery = absl::Milliseconds(500);

AccessEventRow RowOf(const CountedDenial& counted) {
  AccessEventRow row;
  row.who = counted.denial.who;
  row.role = counted.denial.role;
  row.action = counted.denial.action;
  row.detail = counted.denial.why;
  row.count = counted.count;
  return row;
}

}  // namespace

Denial DenialCounter::Others() { return {"others", "", "any", "too many different ones"}; }

DenialCounter::Kind& DenialCounter::KindOf(const Denial& denial) {
  const auto it = kinds_.find(denial);
  if (it != kinds_.end()) return it->second;
  return kinds_[kinds_.size() < most_ ? denial : Others()];
}

void DenialCounter::Add(const Denial& denial) { ++KindOf(denial).count; }

void DenialCounter::Return(const std::vector<CountedDenial>& denials) {
  for (const CountedDenial& counted : denials) KindOf(counted.denial).count += counted.count;
}

std::vector<CountedDenial> DenialCounter::TakeDue(absl::Duration now) {
  std::vector<CountedDenial> due;
  for (auto it = kinds_.begin(); it != kinds_.end();) {
    Kind& kind = it->second;
    const bool recent = now - kind.written < kEvery;
    if (kind.count > 0 && !recent) {
      due.push_back({it->first, std::exchange(kind.count, 0)});
      kind.written = now;
    }
    // One that is written and does not come again needs no place.
    it = kind.count == 0 && now - kind.written >= kEvery ? kinds_.erase(it) : std::next(it);
  }
  return due;
}

void AccessLog::Deny(const Identity& who, Action action, const std::string& why) {
  if (metrics_ != nullptr) metrics_->CountDenial(why);
  const MutexLock lock(mutex_);
  denials_.Add({who.key, std::string(RoleName(who.role)), std::string(ActionName(action)), why});
}

void AccessLog::Act(const Identity& who, Action action, const std::string& subject,
                    const std::string& detail) {
  AccessEventRow row;
  row.kind = "act";
  row.who = who.key;
  row.role = RoleName(who.role);
  row.action = ActionName(action);
  row.subject = subject;
  row.detail = detail;
  const MutexLock lock(mutex_);
  if (acts_.size() >= kMostActs) {
    spdlog::error("{} of {} ({}) is not recorded: the store can't be written", row.action, row.who,
                  row.subject);
    return;
  }
  acts_.push_back(std::move(row));
}

void AccessLog::Touch(int64_t token) {
  const MutexLock lock(mutex_);
  if (tokens_.size() < kMostTokens) tokens_.insert(token);
}

void AccessLog::Start() {
  thread_ = std::jthread([this](const std::stop_token& stop) {
    while (!WaitForStop(stop, kWriteEvery)) Flush();
  });
}

void AccessLog::Flush() {
  const MutexLock writing(writing_);
  Batch batch = TakeDue(clock_.Monotonic());
  if (batch.empty()) return;
  const absl::Status status = WriteBatch(write_, batch);
  if (status.ok()) return;
  // After a deadline the rows may still be written; better none than twice.
  spdlog::warn("denied requests and acts are not recorded yet: {}", std::string(status.message()));
  if (absl::IsDeadlineExceeded(status)) return;
  const MutexLock lock(mutex_);
  batch.acts.insert(batch.acts.end(), std::make_move_iterator(acts_.begin()),
                    std::make_move_iterator(acts_.end()));
  acts_ = std::move(batch.acts);
  denials_.Return(batch.denials);
  tokens_.merge(batch.tokens);
}

AccessLog::Batch AccessLog::TakeDue(absl::Duration now) {
  const MutexLock lock(mutex_);
  return {std::exchange(acts_, {}), denials_.TakeDue(now), std::exchange(tokens_, {})};
}

absl::Status AccessLog::WriteBatch(const Write& write, const Batch& batch) {
  return write([batch](Transaction& writer) {
    absl::Status status;
    for (const AccessEventRow& act : batch.acts) status.Update(writer.callers.AddEvent(act));
    const AccessEventRow others = RowOf({DenialCounter::Others(), 0});
    for (const CountedDenial& counted : batch.denials) {
      status.Update(writer.callers.AddDenial(RowOf(counted), others));
    }
    for (const int64_t token : batch.tokens) {
      // That it was used is not worth losing an event.
      (void)writer.Part([token](Transaction& part) { return part.callers.TouchToken(token); });
    }
    return status;
  });
}

absl::Status AccessLog::WriteAll(const Write& write) {
  const Batch batch = TakeDue(absl::InfiniteDuration());
  return batch.empty() ? absl::OkStatus() : WriteBatch(write, batch);
}

}  // namespace myograde::server
