// Entity tags (RFC 9110): a client that sends back the tag of what it has is told when that is still
// current, and receives nothing again.
#pragma once

#include <string>
#include <string_view>

namespace myograde::server {

// The strong tag of an answer with this body, quotes included.
std::string EntityTagOf(std::string_view body);

// Whether the value of an If-None-Match header has the tag, or is "*". Tags are compared weakly, as
// the RFC asks for; what is no list of tags has none.
bool NamesEntityTag(std::string_view if_none_match, std::string_view tag);

}  // namespace myograde::server
