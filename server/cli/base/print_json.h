// What --json prints.
#pragma once

#include <absl/status/statusor.h>

#include <functional>
#include <string>

#include "server/cli/base/exit_status.h"
#include "server/cli/terminal/text.h"

namespace myograde::server {

// `json` as indented text. Invalid UTF-8 becomes U+FFFD; characters that would do something to a
// terminal or hide (plain_text.h) are escaped, so the value is the same.
std::string ShownJson(const Json& json);

// Prints ShownJson on standard output, and a newline.
void PrintJson(const Json& json);

// `text`, or null if it is "".
Json TextOrNull(const std::string& text);

using AnswerPrinter = std::function<void(const Json& answer)>;

// Prints `text` as Filled (text.h) makes it of an answer, on a line of its own.
AnswerPrinter Sentence(std::string text);

// How a verb ends that has one answer to print: as it is if `json`, else by `print`. Returns
// `exit`, or the error in place of an answer.
absl::StatusOr<int> PrintAnswer(const absl::StatusOr<Json>& answer, bool json,
                                const AnswerPrinter& print, int exit = kDone);

}  // namespace myograde::server
