// What waits and what is played: once, or as a stream of events for as long as somebody looks on.
#pragma once

#include <map>
#include <optional>
#include <string>

#include <absl/status/statusor.h>
#include <absl/time/time.h>

#include "protocol/base/mutex.h"
#include "server/api/context.h"
#include "server/api/guard.h"
#include "server/api/routes.h"

namespace myograde::server {

// Safe from any thread.
class QueueResource {
 public:
  // Both must outlive it.
  QueueResource(const ApiContext& context, Guard& guard) : context_(context), guard_(guard) {}

  void Install(Routes& routes);

 private:
  struct Snapshot {
    std::string text;    // the answer
    std::string stable;  // the same without what changes with the clock alone
    absl::Duration made;
  };

  ApiResult Get(const Request& request);
  absl::Status Follow(const Request& request, Response& response);
  // The queue as the caller sees it, at most a second old: however many look on, those who see the
  // same share one.
  absl::StatusOr<Snapshot> Look();
  absl::StatusOr<Snapshot> Make() const;
  // The caller's next event, "" if nothing has changed since the one in `last`; nullopt: they may not
  // look on any longer, or the store can't be read.
  std::optional<std::string> NextEvent(Snapshot& last);

  const ApiContext& context_;
  Guard& guard_;
  Mutex mutex_;
  std::map<std::string, Snapshot> shared_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
