#include "server/base/peer_key.h"

#include <pwd.h>
#include <unistd.h>

#include <array>
#include <limits>

#include <absl/strings/numbers.h>
#include <absl/strings/str_cat.h>

#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

constexpr size_t kMaxUserNameBytes = 256;

// The kernel keeps the largest number for "none".
bool ReadUid(const std::string& text, uid_t& uid) {
  const bool digits = !text.empty() && text.find_first_not_of("0123456789") == std::string::npos;
  return digits && absl::SimpleAtoi(text, &uid) && uid != std::numeric_limits<uid_t>::max();
}

}  // namespace

std::string PeerKey(uid_t uid) { return absl::StrCat("uid ", uid); }

bool IsOrganiser(const std::string& key) { return key == PeerKey(0) || key == PeerKey(geteuid()); }

absl::StatusOr<std::string> PersonNamed(const std::string& text) {
  uid_t uid = 0;
  std::string number = text;
  if (text.starts_with("uid ")) number = text.substr(4);
  if (ReadUid(number, uid)) return PeerKey(uid);
  struct passwd entry = {};
  struct passwd* found = nullptr;
  std::array<char, 16 << 10> space;
  if (IsPlainText(text, kMaxUserNameBytes) &&
      getpwnam_r(text.c_str(), &entry, space.data(), space.size(), &found) == 0 &&
      found != nullptr) {
    return PeerKey(entry.pw_uid);
  }
  const std::string shown =
      IsPlainText(text, kMaxUserNameBytes) ? absl::StrCat(" \"", text, "\"") : " of this name";
  return absl::InvalidArgumentError(
      absl::StrCat("the daemon's host has no user", shown,
                   "; give a user's name, or a number as in \"uid 1001\""));
}

}  // namespace myograde::server
