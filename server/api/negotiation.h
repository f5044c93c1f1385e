// What a request says of the answer that it takes (RFC 9110).
#pragma once

#include <string_view>

#include <httplib.h>

namespace myograde::server {

// Whether Accept-Encoding names a coding, and does not give it the weight 0.
bool TakesCoding(const httplib::Request& request, std::string_view coding);

// Whether If-None-Match has a tag: what the client has is still current.
bool HasCurrent(const httplib::Request& request, std::string_view tag);

}  // namespace myograde::server
