// Merkle trees over SHA-256, as in RFC 6962: a leaf's hash covers a 0 byte and its content, an
// inner node's a 1 byte and its children's hashes; the left subtree is the largest full one that
// leaves something for the right. So no other list of leaves has the same root.
#pragma once

#include <string>
#include <vector>

namespace myograde::server {

// The root as hexadecimal digits; without leaves, the SHA-256 of the empty string.
std::string MerkleRoot(const std::vector<std::string>& leaves);

}  // namespace myograde::server
