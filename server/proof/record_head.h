// The signed head of the public record: how many entries it has, and what they hash to. A file of
// canonical JSON and a newline:
//
//   {"head": {"chain": HEX, "root": HEX, "size": N}, "signature": {"algorithm": "ed25519", "value": HEX}}
//
// The signature covers the canonical JSON of "head"; the key is that of receipts. Whoever keeps a
// head can show later that an entry was changed or taken out.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/sha256.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/signing_key.h"

namespace myograde::server {

inline constexpr size_t kMaxHeadBytes = 4096;

struct RecordHead {
  int64_t size = 0;
  Sha256Digest root = {};
  std::string chain;  // at the last entry; "": there is none
};

// The text of the file.
absl::StatusOr<std::string> SignHead(const RecordHead& head, const SigningKey& key);

// DataLossError if it is not a head, or not byte for byte in canonical form. The signature is not
// checked.
absl::StatusOr<RecordHead> ParseHead(std::string_view text);

// Whether `text`, which ParseHead has read, was signed with this key.
bool IsHeadSigned(std::string_view text, const PublicKey& key);

// What stands in a copy of the record in place of a receipt that is not public, signed as heads are:
//
//   {"signature": {...}, "withheld": {"evaluation": N, "head": {...}, "reason": "phase"}}
//
// It is of the very record that `head` is of, so that nobody can use it for an earlier or a later one.
struct WithheldReceipt {
  int64_t evaluation = 0;
  // "phase": it withholds results; "rejudge": it was never applied; "unreadable": a row is damaged.
  std::string reason;
  RecordHead head;
};
absl::StatusOr<nlohmann::json> SignWithheld(const WithheldReceipt& withheld, const SigningKey& key);
// DataLossError if it is none, or of another record than `head` is; PermissionDeniedError if it was
// not signed with this key.
absl::StatusOr<WithheldReceipt> CheckWithheld(const nlohmann::json& json, const PublicKey& key,
                                              const RecordHead& head);

// What a copy of the record keeps of an answer with a board: what follows from the record, and
// nothing else, so that every byte can be checked.
nlohmann::json RecordedBoard(const nlohmann::json& answer);

// What a receipt has as "record": the entry, and the proof that it is the last one of the tree that
// it made.
//
//   {"content": {...}, "entry": N, "proof": [HEX, ...], "root": HEX, "size": N + 1}
struct EntryProof {
  int64_t index = 0;
  nlohmann::json content;
  int64_t size = 0;
  Sha256Digest root = {};
  MerkleProof proof;
};
nlohmann::json EntryProofToJson(const EntryProof& proof);
// InvalidArgumentError if it is none, or does not prove what it says.
absl::StatusOr<EntryProof> CheckEntryProof(const nlohmann::json& json);

}  // namespace myograde::server
