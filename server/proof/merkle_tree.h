// A Merkle tree over SHA-256 that grows, as in RFC 6962, section 2.1: a leaf's hash covers a 0 byte
// and its content, an inner node's a 1 byte and its children's hashes; the left subtree is the
// largest full one that leaves something for the right. So no other list of leaves has the same
// root. Proofs show that an entry is in the tree, and that an earlier tree is the beginning of a
// later one.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

#include "protocol/base/sha256.h"

namespace myograde::server {

using MerkleProof = std::vector<Sha256Digest>;

// More nodes than any proof has.
inline constexpr size_t kMaxProofNodes = 2 * 64;

// Keeps the hash of each full subtree, 64 bytes for each leaf. Not thread-safe.
class MerkleTree {
 public:
  void Append(std::string_view leaf);
  int64_t size() const { return levels_.empty() ? 0 : std::ssize(levels_[0]); }

  // The hash of a leaf. REQUIRES: 0 <= leaf < size().
  const Sha256Digest& Leaf(int64_t leaf) const {
    return levels_[0][static_cast<size_t>(leaf)];
  }
  // Of the tree of the first `size` leaves. REQUIRES: 0 <= size <= size().
  Sha256Digest Root(int64_t size) const;
  // PATH(leaf, D[size]) of the RFC. REQUIRES: 0 <= leaf < size <= size().
  MerkleProof InclusionProof(int64_t leaf, int64_t size) const;
  // PROOF(from, D[to]) of the RFC; empty if `from` is 0 or `to`. REQUIRES: 0 <= from <= to <= size().
  MerkleProof ConsistencyProof(int64_t from, int64_t to) const;

 private:
  Sha256Digest HashOf(int64_t begin, int64_t end) const;

  // Entry i of level k is the hash of the leaves from i << k on, 1 << k of them.
  std::vector<std::vector<Sha256Digest>> levels_;
};

// The root of a tree as hexadecimal digits; without leaves, the SHA-256 of the empty string.
std::string MerkleRoot(const std::vector<std::string>& leaves);

Sha256Digest LeafHash(std::string_view leaf);

// Whether the proof shows that a leaf stands at `index` in the tree of `size` leaves with this root.
// Any value may come from a stranger.
bool ProvesInclusion(const Sha256Digest& leaf_hash, int64_t index, int64_t size,
                     const MerkleProof& proof, const Sha256Digest& root);

// Whether the proof shows that the tree of `from` leaves is the beginning of the tree of `to`.
bool ProvesConsistency(int64_t from, const Sha256Digest& from_root, int64_t to,
                       const Sha256Digest& to_root, const MerkleProof& proof);

// A JSON array of hashes, each 64 lower-case hexadecimal digits. InvalidArgumentError if it is not.
nlohmann::json ProofToJson(const MerkleProof& proof);
absl::StatusOr<MerkleProof> ProofOfJson(const nlohmann::json& json);

// The digest with these 64 lower-case hexadecimal digits.
absl::StatusOr<Sha256Digest> DigestOfHex(std::string_view digits);

}  // namespace myograde::server
