// The part of a receipt's checks that is about its config and its seeds, public or hidden.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "server/proof/receipt.h"

namespace myograde::server {

// "" if there is no such text.
std::string TextOf(const nlohmann::json& json, const char* key);

// Valid if both are equal.
ReceiptCheck CompareTexts(const char* name, const std::string& said, const std::string& found);

// Whether `receipt` has the hidden part of format 2, and a commitment in each of `episodes`.
bool HasHiddenShape(const nlohmann::json& receipt);

// Of format 1: "config", "seeds" and "policy_seeds".
std::vector<ReceiptCheck> CheckPublicSeeds(const nlohmann::json& receipt);

// Of format 2: the same and "commitment" and "seed_commitments", or with `secret` "" one check that
// says what can't be checked yet.
std::vector<ReceiptCheck> CheckHiddenSeeds(const nlohmann::json& receipt,
                                           const std::string& secret);

}  // namespace myograde::server
