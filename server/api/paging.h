// Lists come in pages, newest first: every list has the parameters `limit` and `before`, and tells in
// `next_before`, and in a Link header, where the next page begins.
#pragma once

#include <cstdint>
#include <iterator>
#include <limits>
#include <string>

#include <absl/status/statusor.h>

#include "server/api/routes.h"
#include "server/store/damage.h"

namespace myograde::server {

struct Page {
  int64_t before = std::numeric_limits<int64_t>::max();  // only ids below
  int64_t limit = 100;                                   // so many rows at most
};

// InvalidArgumentError for a parameter that is out of its range.
absl::StatusOr<Page> ReadPage(const Request& request);

// Says in an answer to `request` that its list goes on below `last_id` if `more`, or that it ends.
void AddNextPage(const Request& request, bool more, int64_t last_id, ApiAnswer& answer);
// The same for rows that were read as `page`: a full page may have another one behind it.
template <typename Row>
void AddNextPage(const Request& request, const Page& page, const Listed<Row>& listed,
                 ApiAnswer& answer) {
  const bool full = std::ssize(listed.rows) + std::ssize(listed.damaged) >= page.limit;
  AddNextPage(request, full, listed.last_id, answer);
}

}  // namespace myograde::server
