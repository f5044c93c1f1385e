// A board elsewhere: a badge for a team's own page, and a feed for readers of news. Pure functions of
// the answer to GET /v1/leaderboard.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <absl/status/statusor.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// `text` as character data or an attribute's value of XML 1.0: markup is escaped, and characters that
// XML can't hold, that nobody sees or that turn the text around them are shown by their number, as the
// pages do.
std::string XmlText(const std::string& text);

// An SVG that tells a team's rank on the board. NotFoundError: it has none.
absl::StatusOr<std::string> DrawBadge(const nlohmann::json& board, const std::string& team);

// An Atom feed (RFC 4287) with an entry for each row. Times are as RFC 3339 writes them. `changed`: when
// the board last changed, which may have moved any rank. `ended`: when each row's evaluation did;
// those that can't be read are left out.
std::string WriteFeed(const nlohmann::json& board, const std::string& changed,
                      const std::map<int64_t, std::string>& ended);

}  // namespace myograde::server
