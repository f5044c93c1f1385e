// The tree over the public record (server/store/journal.h), kept in memory as the record grows.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <absl/status/statusor.h>

#include "protocol/base/mutex.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/record_head.h"
#include "server/store/store.h"

namespace myograde::server {

// Safe from any thread. Each function first adds the entries that are new in the reader's state, and
// answers for that state. 64 bytes of memory for each entry.
class RecordLog {
 public:
  // Where the record was changed or can't be read, the first few. Such an entry keeps its place, as
  // it is there now, so that everything else goes on.
  std::vector<Damage> Damaged(const Transaction& reader);

  absl::StatusOr<RecordHead> Head(const Transaction& reader);
  // InvalidArgumentError says which number is out of range; `size` 0: of all entries.
  absl::StatusOr<EntryProof> Prove(const Transaction& reader, int64_t entry, int64_t size);

  struct Consistency {
    Sha256Digest from_root;
    Sha256Digest to_root;
    MerkleProof proof;
  };
  absl::StatusOr<Consistency> Compare(const Transaction& reader, int64_t from, int64_t to);

 private:
  void Follow(const Transaction& reader) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Mutex mutex_;
  MerkleTree tree_ ABSL_GUARDED_BY(mutex_);
  std::string chain_ ABSL_GUARDED_BY(mutex_);  // at the last entry
  std::vector<Damage> damaged_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace myograde::server
