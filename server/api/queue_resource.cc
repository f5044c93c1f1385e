#include "server/api/resources.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "server/api/readiness.h"
#include "server/api/redaction.h"
#include "server/http/http_server.h"
#include "server/store/damage.h"

namespace myograde::server {
namespace {

constexpr size_t kShow = 100;
constexpr absl::Duration kLookEvery = absl::Seconds(1);
// So often whoever looks on is told, even if only the estimates have changed: a dead connection is
// noticed, and no proxy takes it for one.
constexpr absl::Duration kTellEvery = absl::Seconds(10);
constexpr absl::Duration kLongest = absl::Minutes(10);
constexpr absl::Duration kFreshFor = absl::Milliseconds(900);

// The entry of what the engine plays or will play; null: it has ended since the engine was asked.
absl::StatusOr<Json> BuildEntry(int64_t id, const Transaction& reader, const ApiContext& context) {
  const absl::StatusOr<EvaluationRow> evaluation = reader.evaluations.Find(id);
  if (absl::IsNotFound(evaluation.status())) return Json();  // it is newer than what is read
  if (!evaluation.ok()) return evaluation.status();
  if (IsFinal(evaluation->state)) return Json();
  ASSIGN_OR_RETURN(const SubmissionRow row, reader.submissions.Find(evaluation->submission));
  const Visibility visibility = FindPhaseVisibility(reader, context, row.phase);
  const EpisodeCounts counts = reader.episodes.Counts(id, !visibility.progress);
  Json entry = SubmissionToJson(row, *evaluation, counts);
  RedactListed(entry, visibility);
  AddOutlook(context, *evaluation, counts, entry);
  return entry;
}

// What is played, or is about to be, comes first: the oldest of it.
void SortByPlace(Json& entries) {
  const auto key = [](const Json& entry) {
    const Json& queue = entry["queue"];
    return std::pair(queue.is_null() ? 0 : queue["position"].get<int64_t>(),
                     entry["submission"].get<int64_t>());
  };
  std::sort(entries.begin(), entries.end(),
            [&](const Json& a, const Json& b) { return key(a) < key(b); });
}

// How busy the host is, and what waits or is played of the submissions that the caller may see.
absl::StatusOr<Json> QueueView(const Transaction& reader, const ApiContext& context) {
  const std::vector<int64_t> queue =
      context.engine.QueueOf(CallerIsOrganiser() ? nullptr : &Caller().teams);
  size_t total = queue.size();
  Json entries = Json::array();
  for (const int64_t id : queue) {
    if (entries.size() == kShow) break;
    absl::StatusOr<Json> entry = BuildEntry(id, reader, context);
    if (IsLeftOut(entry.status())) continue;
    if (!entry.ok()) return entry.status();
    if (entry->is_null()) {
      --total;
    } else {
      entries.push_back(*std::move(entry));
    }
  }
  SortByPlace(entries);
  const LiveHealth health = context.engine.Health();
  return Json{{"status", StatusText(health)},
              {"slots", context.config.scheduler.slots},
              {"running", health.running},
              {"pending_blocks", health.pending},
              {"total", total},
              {"submissions", std::move(entries)}};
}

// Safe from any thread.
class Queue {
 public:
  // Both must outlive it.
  Queue(const ApiContext& context, Guard& guard) : context_(context), guard_(guard) {}

  ApiResult Get(const Request& request) const {
    RETURN_IF_ERROR(CheckParameters(request, {}));
    ASSIGN_OR_RETURN(const Snapshot now, Make());
    return ApiAnswer{.text = std::make_shared<const std::string>(now.text + "\n")};
  }

  absl::Status Follow(const Request& request, Response& response) {
    RETURN_IF_ERROR(CheckParameters(request, {}));
    response.SetHeader("Cache-Control", "no-store");
    response.SetHeader("X-Accel-Buffering", "no");  // proxies hand each event on at once
    response.SetStream("text/event-stream", kLookEvery, kLongest,
                       [this, last = std::make_shared<Snapshot>()] { return NextEvent(*last); });
    return absl::OkStatus();
  }

 private:
  struct Snapshot {
    std::string text;    // the answer
    std::string stable;  // the same without what changes with the clock alone
    absl::Duration made;
  };

  absl::StatusOr<Snapshot> Make() const {
    ASSIGN_OR_RETURN(Json view, ReadStore(context_, [&](const Transaction& reader) {
      return QueueView(reader, context_);
    }));
    std::string text = CanonicalJson(view);
    for (Json& entry : view["submissions"]) {
      for (const char* key : {"running_wall_s", "remaining_wall_s", "estimated_end_at"}) {
        entry.erase(key);
      }
    }
    return Snapshot{std::move(text), CanonicalJson(view), context_.clock.Monotonic()};
  }

  // The queue as the caller sees it, at most a second old: however many look on, those who see the
  // same share one.
  absl::StatusOr<Snapshot> Look() {
    // What all who see the same queue have in common.
    const std::string visibility =
        CallerIsOrganiser() ? "" : absl::StrCat("of ", absl::StrJoin(Caller().teams, "\n"));
    const absl::Duration now = context_.clock.Monotonic();
    {
      const MutexLock lock(mutex_);
      std::erase_if(shared_, [&](const auto& seen) { return now - seen.second.made > kFreshFor; });
      if (const auto it = shared_.find(visibility); it != shared_.end()) return it->second;
    }
    ASSIGN_OR_RETURN(const Snapshot made, Make());
    const MutexLock lock(mutex_);
    shared_[visibility] = made;
    return made;
  }

  // The caller's next event, "" if nothing has changed since the one in `last`; nullopt: they may
  // not look on any longer, or the store can't be read.
  std::optional<std::string> NextEvent(Snapshot& last) {
    // A token may have been revoked, or a member removed, since the event before.
    constexpr Action kAction = Action::kReadSubmission;
    Identity who;
    if (guard_.Admit(HttpServer::RequestConnection(), kAction, who)) return std::nullopt;
    const CallerScope scope(who, kAction, context_.access_log);
    absl::StatusOr<Snapshot> now = Look();
    if (!now.ok()) return std::nullopt;
    if (now->stable == last.stable && now->made - last.made < kTellEvery) return "";
    last = *std::move(now);
    return absl::StrCat("event: queue\ndata: ", last.text, "\n\n");
  }

  const ApiContext& context_;
  Guard& guard_;
  Mutex mutex_;
  std::map<std::string, Snapshot> shared_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

void AddQueue(Routes& routes, const ApiContext& context, Guard& guard) {
  const auto queue = std::make_shared<Queue>(context, guard);
  routes.Get("/v1/queue", Action::kReadSubmission, std::bind_front(&Queue::Get, queue));
  routes.GetFile("/v1/queue/events", Action::kReadSubmission,
                 std::bind_front(&Queue::Follow, queue));
}

}  // namespace myograde::server
