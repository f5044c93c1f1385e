// The roles of callers.
#pragma once

#include <optional>
#include <string_view>

namespace myograde::server {

// Each role may do what those before it may.
enum class Role { kPublic, kParticipant, kOrganiser, kOperator };
std::string_view RoleName(Role role);
std::optional<Role> ParseRole(std::string_view name);

}  // namespace myograde::server
