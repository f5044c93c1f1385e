#include "server/cli/base/print_json.h"

#include <absl/strings/str_format.h>

#include <cstdint>
#include <iostream>
#include <utility>

#include "server/base/plain_text.h"
#include "server/cli/terminal/screen.h"

namespace myograde::server {

std::string ShownJson(const Json& json) {
  const std::string text = json.dump(2, ' ', false, Json::error_handler_t::replace);
  std::string shown;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    if (c == '\n' || !IsHarmful(c)) {
      shown.append(text, begin, at - begin);
    } else if (c < 0x10000) {
      absl::StrAppendFormat(&shown, "\\u%04x", static_cast<uint32_t>(c));
    } else {  // as UTF-16, which is how JSON escapes
      const uint32_t above = static_cast<uint32_t>(c) - 0x10000;
      absl::StrAppendFormat(&shown, "\\u%04x\\u%04x", 0xd800 + (above >> 10),
                            0xdc00 + (above & 0x3ff));
    }
  }
  return shown;
}

void PrintJson(const Json& json) { PlainOutput() << ShownJson(json) << std::endl; }

Json TextOrNull(const std::string& text) { return text.empty() ? Json() : Json(text); }

AnswerPrinter Sentence(std::string text) {
  return [text = std::move(text)](const Json& answer) {
    std::cout << Filled(answer, text) << std::endl;
  };
}

absl::StatusOr<int> PrintAnswer(const absl::StatusOr<Json>& answer, bool json,
                                const AnswerPrinter& print, int exit) {
  if (!answer.ok()) return answer.status();
  if (json) {
    PrintJson(*answer);
  } else {
    print(*answer);
  }
  return exit;
}

}  // namespace myograde::server
