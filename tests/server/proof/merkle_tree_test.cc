// Trees that grow: against the RFC's recursive definitions, and proofs that hold for nothing else.
#include "server/proof/merkle_tree.h"

#include <bit>
#include <span>

#include <absl/strings/escaping.h>
#include <absl/strings/str_cat.h>
#include <gtest/gtest.h>

#include "server/proof/record_head.h"

namespace myograde::server {
namespace {

constexpr int64_t kMost = 40;

using Leaves = std::span<const std::string>;

Leaves First(Leaves leaves, int64_t count) { return leaves.first(static_cast<size_t>(count)); }

// The definitions of RFC 6962, section 2.1, word by word.
size_t Split(size_t leaves) { return std::bit_floor(leaves - 1); }

Sha256Digest NaiveHash(Leaves leaves) {
  if (leaves.empty()) return Sha256Of("");
  if (leaves.size() == 1) return Sha256Of(std::string(1, '\0') + leaves[0]);
  const size_t k = Split(leaves.size());
  std::string node = "\1";
  for (const Sha256Digest& child : {NaiveHash(leaves.first(k)), NaiveHash(leaves.subspan(k))}) {
    node.append(child.begin(), child.end());
  }
  return Sha256Of(node);
}

std::string NaiveRoot(Leaves leaves) { return ToHex(NaiveHash(leaves)); }

void NaivePath(size_t leaf, Leaves leaves, std::vector<std::string>& path) {
  if (leaves.size() == 1) return;
  const size_t k = Split(leaves.size());
  if (leaf < k) {
    NaivePath(leaf, leaves.first(k), path);
    path.push_back(NaiveRoot(leaves.subspan(k)));
  } else {
    NaivePath(leaf - k, leaves.subspan(k), path);
    path.push_back(NaiveRoot(leaves.first(k)));
  }
}

void NaiveSubproof(size_t from, Leaves leaves, bool whole, std::vector<std::string>& proof) {
  if (from == leaves.size()) {
    if (!whole) proof.push_back(NaiveRoot(leaves));
    return;
  }
  const size_t k = Split(leaves.size());
  if (from <= k) {
    NaiveSubproof(from, leaves.first(k), whole, proof);
    proof.push_back(NaiveRoot(leaves.subspan(k)));
  } else {
    NaiveSubproof(from - k, leaves.subspan(k), false, proof);
    proof.push_back(NaiveRoot(leaves.first(k)));
  }
}

std::vector<std::string> Hex(const MerkleProof& proof) {
  std::vector<std::string> digits;
  for (const Sha256Digest& node : proof) digits.push_back(ToHex(node));
  return digits;
}

class MerkleTreeTest : public testing::Test {
 protected:
  MerkleTreeTest() {
    for (int64_t i = 0; i < kMost; ++i) {
      leaves_.push_back(absl::StrCat("entry ", i));
      tree_.Append(leaves_.back());
    }
  }
  std::vector<std::string> leaves_;
  MerkleTree tree_;
};

TEST_F(MerkleTreeTest, RootsAreThoseOfTheDefinition) {
  EXPECT_EQ(tree_.size(), kMost);
  EXPECT_EQ(ToHex(tree_.Root(0)), Sha256Hex(""));
  for (int64_t size = 1; size <= kMost; ++size) {
    EXPECT_EQ(ToHex(tree_.Root(size)), NaiveRoot(First(leaves_, size))) << size;
  }
}

// The inputs of the tests that certificate-transparency's programs share, with their root.
TEST_F(MerkleTreeTest, TheRootOfKnownLeavesIsTheKnownOne) {
  MerkleTree tree;
  for (const char* leaf : {"", "00", "10", "2021", "3031", "40414243", "5051525354555657",
                           "606162636465666768696a6b6c6d6e6f"}) {
    tree.Append(absl::HexStringToBytes(leaf));
  }
  EXPECT_EQ(ToHex(tree.Root(1)),
            "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d");
  EXPECT_EQ(ToHex(tree.Root(8)),
            "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328");
}

TEST_F(MerkleTreeTest, EveryInclusionIsProvedAndNoOther) {
  for (int64_t size = 1; size <= kMost; ++size) {
    const Sha256Digest root = tree_.Root(size);
    for (int64_t leaf = 0; leaf < size; ++leaf) {
      const MerkleProof proof = tree_.InclusionProof(leaf, size);
      std::vector<std::string> naive;
      NaivePath(static_cast<size_t>(leaf), First(leaves_, size), naive);
      ASSERT_EQ(Hex(proof), naive) << leaf << " of " << size;
      const Sha256Digest hash = LeafHash(leaves_[static_cast<size_t>(leaf)]);
      EXPECT_EQ(hash, tree_.Leaf(leaf));
      ASSERT_TRUE(ProvesInclusion(hash, leaf, size, proof, root));
      for (int64_t other = -1; other <= size; ++other) {
        if (other == leaf) continue;
        ASSERT_FALSE(ProvesInclusion(hash, other, size, proof, root)) << leaf << " as " << other;
      }
      ASSERT_FALSE(ProvesInclusion(LeafHash("forged"), leaf, size, proof, root));
      MerkleProof longer = proof;
      longer.push_back(root);
      ASSERT_FALSE(ProvesInclusion(hash, leaf, size, longer, root));
      if (proof.empty()) continue;
      MerkleProof shorter(proof.begin(), proof.end() - 1);
      ASSERT_FALSE(ProvesInclusion(hash, leaf, size, shorter, root));
      MerkleProof altered = proof;
      altered[proof.size() / 2][7] ^= 1;
      ASSERT_FALSE(ProvesInclusion(hash, leaf, size, altered, root));
    }
  }
}

TEST_F(MerkleTreeTest, EveryConsistencyIsProvedAndNoFork) {
  MerkleTree fork;
  for (int64_t i = 0; i < kMost; ++i) {
    fork.Append(i == 3 ? "another" : leaves_[static_cast<size_t>(i)]);
  }
  for (int64_t to = 0; to <= kMost; ++to) {
    for (int64_t from = 0; from <= to; ++from) {
      const MerkleProof proof = tree_.ConsistencyProof(from, to);
      if (from > 0) {
        std::vector<std::string> naive;
        NaiveSubproof(static_cast<size_t>(from), First(leaves_, to), true, naive);
        ASSERT_EQ(Hex(proof), naive) << from << " of " << to;
      }
      ASSERT_TRUE(ProvesConsistency(from, tree_.Root(from), to, tree_.Root(to), proof));
      if (from > 3) {
        ASSERT_FALSE(ProvesConsistency(from, fork.Root(from), to, tree_.Root(to), proof));
        ASSERT_FALSE(ProvesConsistency(from, fork.Root(from), to, tree_.Root(to),
                                       fork.ConsistencyProof(from, to)));
      }
      if (from > 0 && from < to) {
        ASSERT_FALSE(ProvesConsistency(to, tree_.Root(to), from, tree_.Root(from), proof));
        MerkleProof altered = proof;
        altered.back()[0] ^= 1;
        ASSERT_FALSE(ProvesConsistency(from, tree_.Root(from), to, tree_.Root(to), altered));
        altered = proof;
        altered.push_back(tree_.Root(1));
        ASSERT_FALSE(ProvesConsistency(from, tree_.Root(from), to, tree_.Root(to), altered));
      }
    }
  }
}

TEST_F(MerkleTreeTest, ProofsOfStrangersAreReadStrictly) {
  const MerkleProof proof = tree_.InclusionProof(5, kMost);
  EXPECT_EQ(*ProofOfJson(ProofToJson(proof)), proof);
  const std::string hash(64, 'a');
  for (const nlohmann::json& wrong :
       {nlohmann::json(), nlohmann::json("x"), nlohmann::json({1}), nlohmann::json({"aa"}),
        nlohmann::json({std::string(64, 'A')}), nlohmann::json({std::string(64, 'g')}),
        nlohmann::json(std::vector<std::string>(kMaxProofNodes + 1, hash))}) {
    EXPECT_FALSE(ProofOfJson(wrong).ok()) << wrong;
  }
}

TEST_F(MerkleTreeTest, AnEntrysProofHoldsForThatEntryAlone) {
  const nlohmann::json content = {{"kind", "graded"}, {"evaluation", 7}};
  MerkleTree tree;
  tree.Append("{}");
  tree.Append(R"({"evaluation":7,"kind":"graded"})");
  const nlohmann::json json = EntryProofToJson({.index = 1,
                                                .content = content,
                                                .size = 2,
                                                .root = tree.Root(2),
                                                .proof = tree.InclusionProof(1, 2)});
  EXPECT_TRUE(CheckEntryProof(json).ok()) << CheckEntryProof(json).status();
  for (const char* key : {"entry", "content", "size", "root", "proof"}) {
    nlohmann::json without = json;
    without.erase(key);
    EXPECT_FALSE(CheckEntryProof(without).ok()) << key;
  }
  nlohmann::json other = json;
  other["content"]["evaluation"] = 8;
  EXPECT_FALSE(CheckEntryProof(other).ok());
  other = json;
  other["entry"] = 0;
  EXPECT_FALSE(CheckEntryProof(other).ok());
}

}  // namespace
}  // namespace myograde::server
