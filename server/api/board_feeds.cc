#include "server/api/board_feeds.h"

#include <algorithm>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::json;

constexpr int kCharacterWidth = 7;  // of the badge's font, in its units
constexpr int kPadding = 8;

// How wide a text is about; characters of several bytes count once.
int WidthOf(const std::string& text) {
  const auto characters = std::count_if(text.begin(), text.end(),
                                        [](char c) { return (c & 0xC0) != 0x80; });
  return static_cast<int>(characters) * kCharacterWidth + 2 * kPadding;
}

std::string FeedSubject(const Json& board) {
  const std::string name =
      (board["phase"].is_string() ? board["phase"] : board["track"]).get<std::string>();
  const auto which = board["board"].get<std::string>();
  return which == "main" ? name : absl::StrCat(name, ", ", which);
}

std::string PlaceOf(const Json& row) {
  if (row["rank"].is_null()) return "baseline";
  return absl::StrCat("rank ", row["rank"].get<int64_t>());
}

// `ended`: "" if that can't be read.
std::string WriteEntry(const Json& board, const Json& row, const std::string& changed,
                       const std::string& ended) {
  const Json& aggregate = row["aggregate"];
  const std::string results =
      absl::StrCat(aggregate.value("successes", int64_t{0}), " of ",
                   aggregate.value("episodes", int64_t{0}), " episodes succeeded");
  const std::string team = XmlText(row["team"].get<std::string>());
  return absl::StrCat(
      "<entry><id>urn:myograde:", board["config"].get<std::string>(), ":",
      XmlText(board["board"].get<std::string>()), ":", row["evaluation"].get<int64_t>(),
      "</id><title>", team, ": ", PlaceOf(row), "</title>",
      ended.empty() ? "" : absl::StrCat("<published>", ended, "</published>"), "<updated>", changed,
      "</updated><author><name>", team, "</name></author><content type=\"text\">",
      XmlText(row["name"].get<std::string>()), ": ", results, "</content></entry>\n");
}

}  // namespace

std::string XmlText(const std::string& text) {
  static const std::map<char32_t, const char*> kReplaced = {
      {'&', "&amp;"},  {'<', "&lt;"},    {'>', "&gt;"},
      {'"', "&quot;"}, {'\'', "&#39;"}, {kBroken, "\uFFFD"}};
  std::string escaped;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    if (const auto it = kReplaced.find(c); it != kReplaced.end()) {
      escaped += it->second;
    } else if ((IsUnsafe(c) && c != '\t' && c != '\n') || (c & 0xfffe) == 0xfffe) {
      absl::StrAppendFormat(&escaped, "⟨U+%04X⟩", static_cast<uint32_t>(c));
    } else {
      escaped.append(text, begin, at - begin);
    }
  }
  return escaped;
}

absl::StatusOr<std::string> DrawBadge(const nlohmann::json& board, const std::string& team) {
  const Json& rows = board["rows"];
  const auto ranked = [](const Json& one) { return !one["rank"].is_null(); };
  const auto its = [&](const Json& one) { return one["team"] == team; };
  // A team's baseline may stand above its ranked row.
  auto row = std::find_if(rows.begin(), rows.end(),
                          [&](const Json& one) { return its(one) && ranked(one); });
  if (row == rows.end()) row = std::find_if(rows.begin(), rows.end(), its);
  if (row == rows.end()) {
    return absl::NotFoundError(absl::StrCat("there is no team \"", team, "\" on this board"));
  }
  const std::string left = FeedSubject(board);
  const auto teams = std::count_if(rows.begin(), rows.end(), ranked);
  const std::string right =
      ranked(*row) ? absl::StrCat(PlaceOf(*row), " of ", teams) : PlaceOf(*row);
  const int middle = WidthOf(left);
  const int width = middle + WidthOf(right);
  return absl::StrFormat(
      R"(<svg xmlns="http://www.w3.org/2000/svg" width="%d" height="20" role="img" aria-label="%s">)"
      R"(<title>%s</title><rect width="%d" height="20" rx="4" fill="#3a48c4"/>)"
      R"(<path d="M4 0h%dv20H4a4 4 0 0 1-4-4V4a4 4 0 0 1 4-4z" fill="#33374a"/>)"
      R"(<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" )"
      R"(text-anchor="middle"><text x="%d" y="14">%s</text><text x="%d" y="14">%s</text></g></svg>)"
      "\n",
      width, XmlText(absl::StrCat(left, ": ", right)),
      XmlText(absl::StrCat(team, ", ", left, ": ", right)), width, middle - 4, middle / 2,
      XmlText(left), middle + (width - middle) / 2, XmlText(right));
}

std::string WriteFeed(const nlohmann::json& board, const std::string& changed,
                      const std::map<int64_t, std::string>& ended) {
  std::string entries;
  for (const Json& row : board["rows"]) {
    const auto at = ended.find(row["evaluation"].get<int64_t>());
    entries += WriteEntry(board, row, changed, at == ended.end() ? "" : at->second);
  }
  const std::string subject = XmlText(FeedSubject(board));
  return absl::StrCat("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
                      "<feed xmlns=\"http://www.w3.org/2005/Atom\"><id>urn:myograde:",
                      board["config"].get<std::string>(), ":",
                      XmlText(board["board"].get<std::string>()), "</id><title>MyoGrade: ",
                      subject, "</title><updated>", changed,
                      "</updated><author><name>MyoGrade</name></author>\n", entries, "</feed>\n");
}

}  // namespace myograde::server
