// The API's description, an OpenAPI 3.1 document (README.md). Its source is made by bundle.py.
#pragma once

#include <string_view>

namespace myograde::server {

// JSON, with a line break at its end.
std::string_view OpenApiDocument();

}  // namespace myograde::server
