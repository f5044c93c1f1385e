#include "server/store/record_check.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

constexpr int64_t kEntriesAtATime = 10'000;

}  // namespace

std::string ChainMistake(const std::string& before, const RecordRow* entry) {
  if (entry == nullptr) return "it is gone, or of another type";
  if (entry->chain == ChainOf(before, entry->entry_json)) return "";
  return "its \"chain\" does not follow from the entry before: the record was changed here, behind "
         "the daemon's back";
}

absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most) {
  std::vector<Damage> damaged;
  RETURN_IF_ERROR(readers.Read([&](Reader& reader) {
    const int64_t size = reader.RecordSize();
    std::string chain;
    int64_t next = 0;
    const auto add = [&](const RecordRow* entry) {
      std::string mistake = ChainMistake(chain, entry);
      if (!mistake.empty() && damaged.size() < most) {
        damaged.push_back({"record", absl::StrCat(next), std::move(mistake)});
      }
      chain = entry == nullptr ? "" : entry->chain;
      ++next;
    };
    while (next < size && damaged.size() < most) {
      const int64_t end = std::min(size, next + kEntriesAtATime);
      for (const RecordRow& row : reader.Record(next, end - next).rows) {
        while (next < row.index && next < size) add(nullptr);
        add(&row);
      }
      while (next < end) add(nullptr);
    }
    return absl::OkStatus();
  }));
  return damaged;
}

}  // namespace myograde::server
