// Lines that a runner prints: an accepted record is written and read again to the same line.
#include "protocol/lease/lease.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;

MYOGRADE_FUZZ_TARGET(record)(const uint8_t* data, size_t size) {
  const std::string_view line(reinterpret_cast<const char*>(data), size);
  const absl::StatusOr<LeaseRecord> record = LeaseRecordFromLine(line);
  if (!record.ok()) {
    fuzz::Require(!record.status().message().empty(), "a refusal says why");
    return 0;
  }
  const std::string written = LeaseRecordToLine(*record);
  fuzz::Require(written.find('\n') == std::string::npos, "a record is one line");
  const absl::StatusOr<LeaseRecord> again = LeaseRecordFromLine(written);
  fuzz::Require(again.ok(), "what was written can be read");
  fuzz::Require(again->index() == record->index(), "a record keeps its type");
  fuzz::Require(LeaseRecordToLine(*again) == written, "a record keeps its values");
  return 0;
}
