#include "server/config/user_names.h"

#include <grp.h>
#include <pwd.h>

#include <absl/strings/str_cat.h>

namespace myograde::server {

absl::Status ResolveNames(const std::string& where, AccessConfig& access) {
  for (size_t i = 0; i < access.users.size(); ++i) {
    UserRule& rule = access.users[i];
    const std::string place = absl::StrCat(where, ": access: users[", i, "]: ");
    if (!rule.user.empty()) {
      const passwd* user = ::getpwnam(rule.user.c_str());
      if (user == nullptr) {
        return absl::InvalidArgumentError(absl::StrCat(
            place, "this host has no user \"", rule.user, "\"; correct the name, or give a uid"));
      }
      rule.uid = user->pw_uid;
    } else if (!rule.group.empty()) {
      const group* members = ::getgrnam(rule.group.c_str());
      if (members == nullptr) {
        return absl::InvalidArgumentError(absl::StrCat(
            place, "this host has no group \"", rule.group, "\"; correct the name, or give a gid"));
      }
      rule.gid = members->gr_gid;
    }
  }
  return absl::OkStatus();
}

}  // namespace myograde::server
