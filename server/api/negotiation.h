// What a request says of the answer that it takes (RFC 9110).
#pragma once

#include <string_view>

#include <httplib.h>

namespace myograde::server {

// How handlers see the header Accept-Encoding (http_request.h).
inline constexpr char kAcceptEncoding[] = "Myograde-Accept-Encoding";

// Whether Accept-Encoding takes a coding ("gzip", "zstd"), and does not prefer the answer as it is.
bool TakesCoding(const httplib::Request& request, std::string_view coding);

// Whether If-None-Match has a tag: what the client has is still current.
bool HasCurrent(const httplib::Request& request, std::string_view tag);

}  // namespace myograde::server
