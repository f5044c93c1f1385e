// Merkle trees over SHA-256, in the shape of RFC 6962: a leaf's hash is taken
// over a byte 0 and its content, an inner node's over a byte 1 and the hashes
// of its children; the left subtree is the largest full one that leaves
// something for the right. So no list of leaves can pass for another.
#pragma once

#include <string>
#include <vector>

namespace myograde::server {

// The root as hexadecimal digits; of no leaves, the SHA-256 of nothing.
std::string MerkleRoot(const std::vector<std::string>& leaves);

}  // namespace myograde::server
