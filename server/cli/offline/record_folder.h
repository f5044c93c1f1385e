// The folder that "myograde proof record export" writes, as received from somebody: its files may be
// of any size and any kind.
//
//   record.jsonl            the entries, one a line
//   head.json               their signed head (server/proof/record_head.h)
//   key.pem                 the key that signed
//   receipts/EVALUATION.json
//   withheld.json           the evaluations whose receipts are not public, and why
//   configs/HASH.json       the config of each receipt, as far as it is public
//   boards/HASH.BOARD.json  each board of each config
//   secrets/PHASE.txt       the secrets of revealed phases
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include <absl/status/statusor.h>

#include "protocol/base/fd.h"

namespace myograde::server {

class RecordFolder {
 public:
  // Lists it. InvalidArgumentError names what does not belong there: another name, a link, a device,
  // more files than any record has.
  static absl::StatusOr<RecordFolder> Open(const std::string& path);

  // A file by its path in the folder: "head.json". InvalidArgumentError if it is missing, or not a
  // regular file.
  absl::StatusOr<Fd> OpenFile(const std::string& name) const;
  // Its content. InvalidArgumentError also if it is larger than `max_bytes`.
  absl::StatusOr<std::string> Read(const std::string& name, int64_t max_bytes) const;
  bool Has(const std::string& name) const { return files_.contains(name); }
  // The paths that begin with `folder`, sorted: "receipts/".
  std::set<std::string> In(std::string_view folder) const;

 private:
  explicit RecordFolder(Fd fd) : fd_(std::move(fd)) {}

  Fd fd_;
  std::set<std::string> files_;
};

}  // namespace myograde::server
