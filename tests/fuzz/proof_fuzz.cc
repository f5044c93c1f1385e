// Heads and proofs of the public record, which anybody may hand on.
#include "protocol/base/config_reader.h"
#include "server/proof/merkle_tree.h"
#include "server/proof/record_head.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using namespace myograde::server;
using fuzz::Require;

// The first byte: a head, or the proof of an entry; the next three: numbers for a consistency.
MYOGRADE_FUZZ_TARGET(proof)(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const bool head = (input.Byte() & 1) == 0;
  const int64_t from = input.Byte();
  const int64_t to = input.Byte();
  const std::string text = input.RestText();
  if (head) {
    const absl::StatusOr<RecordHead> parsed = ParseHead(text);
    Require(parsed.ok() || absl::IsDataLoss(parsed.status()), "what is not a head is told so");
    return 0;
  }
  const absl::StatusOr<nlohmann::json> json = ParseJson(text, "proof");
  if (!json.ok()) return 0;
  const absl::StatusOr<EntryProof> proof = CheckEntryProof(*json);
  if (proof.ok()) {
    Require(EntryProofToJson(*proof) == *json, "a proof has nothing that is not checked");
    Require(proof->index < proof->size, "an entry is in its record");
  }
  const absl::StatusOr<MerkleProof> nodes = ProofOfJson(*json);
  if (!nodes.ok()) return 0;
  const Sha256Digest one = Sha256Of("one");
  Require(!ProvesInclusion(one, from, to, *nodes, Sha256Of("two")), "no leaf is in a strange tree");
  Require(from == to || !ProvesConsistency(from, one, to, one, *nodes),
          "a longer record has another root");
  return 0;
}
