#include "server/base/log_line.h"

#include <utility>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <nlohmann/json.hpp>

#include "server/base/json_value.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

using Json = nlohmann::ordered_json;

thread_local const LogFields* current_fields = nullptr;

// A backslash stays as it is: messages quote paths and JSON, and a line is for people.
std::string Escaped(std::string_view text) {
  std::string escaped;
  escaped.reserve(text.size());
  for (size_t at = 0; at < text.size();) {
    const size_t from = at;
    const char32_t c = TakeCodePoint(text, at);
    if (c == kBroken) {
      absl::StrAppendFormat(&escaped, "\\x%02x", static_cast<unsigned char>(text[from]));
    } else if (c == '\n') {
      escaped += "\\n";
    } else if (c == '\t') {
      escaped += "\\t";
    } else if (IsUnsafe(c)) {
      absl::StrAppendFormat(&escaped, "\\u{%x}", static_cast<uint32_t>(c));
    } else {
      escaped.append(text.substr(from, at - from));
    }
  }
  return escaped;
}

std::string JsonLine(absl::Time time, std::string_view level, std::string_view message,
                     const LogFields& fields) {
  Json line = {{"time", TimeText(time)},
               {"level", level},
               {"message", message}};
  const std::pair<const char*, int64_t> numbers[] = {{"submission", fields.submission},
                                                     {"evaluation", fields.evaluation},
                                                     {"lease", fields.lease},
                                                     {"attempt", fields.attempt},
                                                     {"delivery", fields.delivery}};
  for (const auto& [key, value] : numbers) {
    if (value != 0) line[key] = value;
  }
  if (!fields.team.empty()) line["team"] = fields.team;
  if (!fields.webhook.empty()) line["webhook"] = fields.webhook;
  // In ASCII no terminal and no tool sees a line's end or a control character.
  return line.dump(-1, ' ', /*ensure_ascii=*/true, Json::error_handler_t::replace) + "\n";
}

}  // namespace

LogScope::LogScope(LogFields fields) : fields_(std::move(fields)), before_(current_fields) {
  current_fields = &fields_;
}

LogScope::~LogScope() { current_fields = before_; }

const LogFields& CurrentLogFields() {
  static const LogFields none;
  return current_fields == nullptr ? none : *current_fields;
}

std::string LogLine(LogFormat format, absl::Time time, std::string_view level,
                    std::string_view message, const LogFields& fields) {
  if (format == LogFormat::kJson) return JsonLine(time, level, message, fields);
  return absl::StrCat(absl::FormatTime("%Y-%m-%dT%H:%M:%E3S%z", time, absl::LocalTimeZone()), " ",
                      std::string(level), " ", Escaped(message), "\n");
}

}  // namespace myograde::server
