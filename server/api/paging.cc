#include "server/api/paging.h"

#include <absl/strings/str_cat.h>

#include "server/api/requests.h"

namespace myograde::server {
namespace {

constexpr int64_t kMaxLimit = 1000;

}  // namespace

absl::StatusOr<Page> ReadPage(const Request& request) {
  Page page;
  absl::Status status = ReadNumber(request, "before", page.before, page.before);
  status.Update(ReadNumber(request, "limit", kMaxLimit, page.limit));
  if (!status.ok()) return status;
  return page;
}

void AddNextPage(const Request& request, bool more, int64_t last_id, ApiAnswer& answer) {
  answer.body["next_before"] = more ? nlohmann::json(last_id) : nlohmann::json();
  if (!more) return;
  answer.next = absl::StrCat(request.path, "?before=", last_id);
  for (const auto& [key, value] : request.params) {
    if (key == "before") continue;
    absl::StrAppend(&answer.next, "&", EncodeForQuery(key), "=", EncodeForQuery(value));
  }
}

}  // namespace myograde::server
