// What a request says of the answer that it takes (RFC 9110), and entity tags: a client that sends
// back the tag of what it has is told when that is still current, and receives nothing again.
#pragma once

#include <string>
#include <string_view>

#include "server/http/request.h"
#include "server/http/response.h"

namespace myograde::server {

// The strong tag of an answer with this body, quotes included.
std::string ComputeEntityTag(std::string_view body);

// Whether the value of an If-None-Match header has the tag, or is "*". Tags are compared weakly, as
// the RFC asks for; what is not a list of tags has none.
bool NamesEntityTag(std::string_view if_none_match, std::string_view tag);

// Sets an answer's ETag. True: If-None-Match has it, so the answer is 304, without a body.
bool AnswersWithTag(const Request& request, const std::string& tag, Response& response);

// Whether Accept-Encoding takes a coding ("gzip", "zstd"), and does not prefer the answer as it is.
bool TakesCoding(const Request& request, std::string_view coding);

}  // namespace myograde::server
