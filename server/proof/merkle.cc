#include "server/proof/merkle.h"

#include <bit>
#include <span>
#include <string_view>

#include "protocol/base/sha256.h"

namespace myograde::server {
namespace {

using namespace std::string_view_literals;

std::string_view BytesOf(const Sha256Digest& digest) {
  return {reinterpret_cast<const char*>(digest.data()), digest.size()};
}

Sha256Digest RootOf(std::span<const std::string> leaves) {
  Sha256 hash;
  if (leaves.size() == 1) {
    hash.Update("\0"sv);
    hash.Update(leaves[0]);
    return hash.Finish();
  }
  const size_t left = std::bit_floor(leaves.size() - 1);
  hash.Update("\1"sv);
  hash.Update(BytesOf(RootOf(leaves.first(left))));
  hash.Update(BytesOf(RootOf(leaves.subspan(left))));
  return hash.Finish();
}

}  // namespace

std::string MerkleRoot(const std::vector<std::string>& leaves) {
  return leaves.empty() ? Sha256Hex("") : HexOf(RootOf(leaves));
}

}  // namespace myograde::server
