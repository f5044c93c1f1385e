// Bearer tokens as text: "myo_" and 64 hexadecimal digits. Only their hashes are kept.
#pragma once

#include <string>
#include <string_view>

#include <absl/status/statusor.h>

namespace myograde::server {

// A new token of 256 random bits. InternalError: the host has no random numbers.
absl::StatusOr<std::string> NewTokenText();

// Whether the text has a token's form. Says nothing about its validity.
bool IsTokenText(std::string_view text);

// What the store knows a token by: the text's SHA-256, in lower-case hexadecimal. Finding it by an
// index leaks nothing through the time that this takes, as nobody can choose a hash's digits
// without the text.
std::string TokenHash(std::string_view text);

}  // namespace myograde::server
