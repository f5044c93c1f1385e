#include "server/api/queue_resource.h"

#include <functional>
#include <memory>
#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>

#include "protocol/base/config_reader.h"
#include "protocol/base/status_macros.h"
#include "server/api/queue_view.h"
#include "server/api/requests.h"
#include "server/api/unix_http_server.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr absl::Duration kLookEvery = absl::Seconds(1);
// So often whoever looks on is told, even if only the estimates have changed: a dead connection is
// noticed, and no proxy takes it for one.
constexpr absl::Duration kTellEvery = absl::Seconds(10);
constexpr absl::Duration kLongest = absl::Minutes(10);
constexpr absl::Duration kFreshFor = absl::Milliseconds(900);

// What all who see the same queue have in common.
std::string SightOfCaller() {
  return CallerIsOrganiser() ? "" : absl::StrCat("of ", absl::StrJoin(Caller().teams, "\n"));
}

std::string StableText(Json view) {
  for (Json& entry : view["submissions"]) {
    for (const char* key : {"running_wall_s", "remaining_wall_s", "estimated_end_at"}) {
      entry.erase(key);
    }
  }
  return CanonicalJson(view);
}

}  // namespace

void QueueResource::Install(Routes& routes) {
  using Self = QueueResource;
  routes.Get("/v1/queue", Action::kReadSubmission, std::bind_front(&Self::Get, this));
  routes.GetFile("/v1/queue/events", Action::kReadSubmission,
                 std::bind_front(&Self::Follow, this));
}

absl::StatusOr<QueueResource::Snapshot> QueueResource::Make() const {
  Snapshot made;
  RETURN_IF_ERROR(context_.readers.Read([&](Reader& reader) -> absl::Status {
    ASSIGN_OR_RETURN(Json view, QueueView(reader, context_));
    made.text = CanonicalJson(view);
    made.stable = StableText(std::move(view));
    return absl::OkStatus();
  }));
  made.made = context_.clock.Monotonic();
  return made;
}

absl::StatusOr<QueueResource::Snapshot> QueueResource::Look() {
  const std::string sight = SightOfCaller();
  const absl::Duration now = context_.clock.Monotonic();
  {
    const MutexLock lock(mutex_);
    std::erase_if(shared_, [&](const auto& entry) { return now - entry.second.made > kFreshFor; });
    if (const auto it = shared_.find(sight); it != shared_.end()) return it->second;
  }
  absl::StatusOr<Snapshot> made = Make();
  if (!made.ok()) return made;
  const MutexLock lock(mutex_);
  shared_[sight] = *made;
  return made;
}

ApiResult QueueResource::Get(const Request& request) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  ASSIGN_OR_RETURN(const Snapshot now, Make());
  return ApiAnswer{.text = std::make_shared<const std::string>(now.text + "\n")};
}

std::optional<std::string> QueueResource::NextEvent(Snapshot& last) {
  // A token may have been revoked, or a member removed, since the event before.
  const auto admitted =
      guard_.Admit(UnixHttpServer::RequestConnection(), Action::kReadSubmission);
  const auto* identity = std::get_if<Identity>(&admitted);
  if (identity == nullptr) return std::nullopt;
  const CallerScope scope(*identity, Action::kReadSubmission, guard_.log());
  absl::StatusOr<Snapshot> now = Look();
  if (!now.ok()) return std::nullopt;
  if (now->stable == last.stable && now->made - last.made < kTellEvery) return "";
  last = *std::move(now);
  return absl::StrCat("event: queue\ndata: ", last.text, "\n\n");
}

absl::Status QueueResource::Follow(const Request& request, Response& response) {
  RETURN_IF_ERROR(CheckParameters(request, {}));
  response.SetHeader("Cache-Control", "no-store");
  response.SetHeader("X-Accel-Buffering", "no");  // proxies hand each event on at once
  response.SetStream("text/event-stream", kLookEvery, kLongest,
                     [this, last = std::make_shared<Snapshot>()] { return NextEvent(*last); });
  return absl::OkStatus();
}

}  // namespace myograde::server
