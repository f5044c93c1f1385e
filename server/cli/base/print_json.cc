#include "server/cli/base/print_json.h"

#include <ostream>

#include "server/cli/terminal/screen.h"

namespace myograde::server {

void PrintJson(const nlohmann::json& json) {
  PlainOutput() << json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) << std::endl;
}

}  // namespace myograde::server
