// What a request says of the answer that it takes (RFC 9110).
#pragma once

#include <string_view>

#include "server/api/http_request.h"

namespace myograde::server {

// Whether Accept-Encoding takes a coding ("gzip", "zstd"), and does not prefer the answer as it is.
bool TakesCoding(const Request& request, std::string_view coding);

// Whether If-None-Match has a tag: what the client has is still current.
bool HasCurrent(const Request& request, std::string_view tag);

}  // namespace myograde::server
