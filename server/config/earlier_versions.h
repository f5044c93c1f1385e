// Files server.json of the first versions, which lack whole parts that later ones require.
#pragma once

#include <nlohmann/json.hpp>

namespace myograde::server {

// `json` with the shipped values of what the first versions' files did not have yet, if it has none
// of its own. Single keys that came after those are defaults of server_config.cc. What is no object
// comes back as it is: its reader says what is wrong.
nlohmann::json WithLaterParts(nlohmann::json json);

}  // namespace myograde::server
