// Follows the chain of the public record (record.h).
#pragma once

#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "server/store/damage.h"
#include "server/store/reader.h"

namespace myograde::server {

// What is wrong at an entry: nullptr if it can't be read or is gone. `before`: the chain at the entry
// before, "" for the first. "": nothing.
std::string ChainMistake(const std::string& before, const RecordRow* entry);

// The first entries, so many at most, at which the chain breaks. Errors of ReaderPool::Read.
absl::StatusOr<std::vector<Damage>> CheckRecordChain(ReaderPool& readers, size_t most);

}  // namespace myograde::server
