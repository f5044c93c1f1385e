// How a receiver knows that an event came from this daemon, and when.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace myograde::server {

inline constexpr char kSignatureHeader[] = "X-MyoGrade-Signature";
inline constexpr char kEventIdHeader[] = "Idempotency-Key";

// "t=1764590400,v1=DIGITS": the time of the attempt in seconds since 1970, and the HMAC-SHA256 of
// "1764590400.BODY" keyed with the secret's bytes, in lower-case hexadecimal.
std::string SignatureOf(std::string_view secret, int64_t seconds, std::string_view body);

}  // namespace myograde::server
