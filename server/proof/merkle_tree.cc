#include "server/proof/merkle_tree.h"

#include <algorithm>
#include <bit>
#include <cstddef>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>

#include "protocol/base/status_macros.h"

namespace myograde::server {
namespace {

std::string_view Bytes(const Sha256Digest& digest) {
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

Sha256Digest NodeHash(const Sha256Digest& left, const Sha256Digest& right) {
  return Sha256Of(absl::StrCat(absl::string_view("\1", 1),
                               absl::string_view(Bytes(left).data(), left.size()),
                               absl::string_view(Bytes(right).data(), right.size())));
}

// Where the RFC splits a tree of more than one leaf: the largest power of two below `leaves`.
int64_t SplitOf(int64_t leaves) {
  return static_cast<int64_t>(std::bit_floor(static_cast<uint64_t>(leaves) - 1));
}

}  // namespace

Sha256Digest LeafHash(std::string_view leaf) {
  Sha256 hash;
  hash.Update(std::string_view("\0", 1));
  hash.Update(leaf);
  return hash.Finish();
}

void MerkleTree::Append(std::string_view leaf) {
  Sha256Digest hash = LeafHash(leaf);
  for (size_t level = 0;; ++level) {
    if (level == levels_.size()) levels_.emplace_back();
    std::vector<Sha256Digest>& nodes = levels_[level];
    nodes.push_back(hash);
    if (nodes.size() % 2 != 0) return;
    hash = NodeHash(nodes[nodes.size() - 2], nodes.back());
  }
}

Sha256Digest MerkleTree::HashOf(int64_t begin, int64_t end) const {
  const uint64_t leaves = static_cast<uint64_t>(end - begin);
  if (std::has_single_bit(leaves)) {  // a full subtree begins at a multiple of its size
    const int level = std::countr_zero(leaves);
    return levels_[static_cast<size_t>(level)][static_cast<size_t>(begin >> level)];
  }
  const int64_t middle = begin + SplitOf(end - begin);
  return NodeHash(HashOf(begin, middle), HashOf(middle, end));
}

Sha256Digest MerkleTree::Root(int64_t size) const {
  return size == 0 ? Sha256Of("") : HashOf(0, size);
}

std::string MerkleRoot(const std::vector<std::string>& leaves) {
  MerkleTree tree;
  for (const std::string& leaf : leaves) tree.Append(leaf);
  return ToHex(tree.Root(tree.size()));
}

MerkleProof MerkleTree::InclusionProof(int64_t leaf, int64_t size) const {
  MerkleProof proof;
  int64_t begin = 0;
  int64_t end = size;
  while (end - begin > 1) {
    const int64_t middle = begin + SplitOf(end - begin);
    if (leaf < middle) {
      proof.push_back(HashOf(middle, end));
      end = middle;
    } else {
      proof.push_back(HashOf(begin, middle));
      begin = middle;
    }
  }
  std::reverse(proof.begin(), proof.end());  // from the leaf upwards
  return proof;
}

MerkleProof MerkleTree::ConsistencyProof(int64_t from, int64_t to) const {
  MerkleProof proof;
  if (from == 0 || from == to) return proof;
  int64_t begin = 0;
  int64_t end = to;
  while (end != from) {
    const int64_t middle = begin + SplitOf(end - begin);
    if (from <= middle) {
      proof.push_back(HashOf(middle, end));
      end = middle;
    } else {
      proof.push_back(HashOf(begin, middle));
      begin = middle;
    }
  }
  // Whoever checks it knows the earlier tree's root, but not that of a part of it.
  if (begin != 0) proof.push_back(HashOf(begin, end));
  std::reverse(proof.begin(), proof.end());
  return proof;
}

// The algorithm of RFC 9162, section 2.1.3.2.
bool ProvesInclusion(const Sha256Digest& leaf_hash, int64_t index, int64_t size,
                     const MerkleProof& proof, const Sha256Digest& root) {
  if (index < 0 || index >= size) return false;
  int64_t node = index;
  int64_t last = size - 1;
  Sha256Digest hash = leaf_hash;
  for (const Sha256Digest& sibling : proof) {
    if (last == 0) return false;
    if (node % 2 == 1 || node == last) {
      hash = NodeHash(sibling, hash);
      while (node % 2 == 0 && node != 0) {
        node >>= 1;
        last >>= 1;
      }
    } else {
      hash = NodeHash(hash, sibling);
    }
    node >>= 1;
    last >>= 1;
  }
  return last == 0 && hash == root;
}

// The algorithm of RFC 9162, section 2.1.4.2.
bool ProvesConsistency(int64_t from, const Sha256Digest& from_root, int64_t to,
                       const Sha256Digest& to_root, const MerkleProof& proof) {
  if (from < 0 || from > to) return false;
  if (from == to) return proof.empty() && from_root == to_root;
  if (from == 0) return proof.empty() && from_root == Sha256Of("");
  const bool full = std::has_single_bit(static_cast<uint64_t>(from));
  if (proof.empty() && !full) return false;
  size_t next = 0;
  Sha256Digest earlier = full ? from_root : proof[next++];
  Sha256Digest later = earlier;
  int64_t node = from - 1;
  int64_t last = to - 1;
  while (node % 2 == 1) {
    node >>= 1;
    last >>= 1;
  }
  for (; next < proof.size(); ++next) {
    if (last == 0) return false;
    if (node % 2 == 1 || node == last) {
      earlier = NodeHash(proof[next], earlier);
      later = NodeHash(proof[next], later);
      while (node % 2 == 0 && node != 0) {
        node >>= 1;
        last >>= 1;
      }
    } else {
      later = NodeHash(later, proof[next]);
    }
    node >>= 1;
    last >>= 1;
  }
  return last == 0 && earlier == from_root && later == to_root;
}

nlohmann::json ProofToJson(const MerkleProof& proof) {
  nlohmann::json json = nlohmann::json::array();
  for (const Sha256Digest& node : proof) json.push_back(ToHex(node));
  return json;
}

absl::StatusOr<Sha256Digest> DigestOfHex(std::string_view digits) {
  Sha256Digest digest;
  if (!IsSha256Hex(digits)) {
    return absl::InvalidArgumentError("a hash has 64 lower-case hexadecimal digits");
  }
  const std::string bytes = absl::HexStringToBytes({digits.data(), digits.size()});
  std::copy(bytes.begin(), bytes.end(), digest.begin());
  return digest;
}

absl::StatusOr<MerkleProof> ProofOfJson(const nlohmann::json& json) {
  if (!json.is_array() || json.size() > kMaxProofNodes) {
    return absl::InvalidArgumentError(
        absl::StrCat("a proof is a list of at most ", kMaxProofNodes, " hashes"));
  }
  MerkleProof proof;
  for (const nlohmann::json& node : json) {
    if (!node.is_string()) return absl::InvalidArgumentError("a proof is a list of hashes");
    ASSIGN_OR_RETURN(const Sha256Digest digest, DigestOfHex(node.get_ref<const std::string&>()));
    proof.push_back(digest);
  }
  return proof;
}

}  // namespace myograde::server
