#include "server/cli/terminal.h"

#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <iostream>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/clock.h"
#include "server/plain_text.h"

namespace myograde::server {
namespace {

bool HasColour() {
  const char* no_color = std::getenv("NO_COLOR");
  return ::isatty(STDOUT_FILENO) == 1 && (no_color == nullptr || *no_color == '\0');
}

// Columns that a text takes, counting UTF-8 sequences as one.
size_t Width(const std::string& text) {
  return static_cast<size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

bool IsNumber(const std::string& cell) {
  return cell == "-" || (!cell.empty() && cell.find_first_not_of("0123456789.+-e%") ==
                                              std::string::npos);
}

}  // namespace

std::string Harmless(std::string_view text, bool lines) {
  std::string harmless;
  for (size_t at = 0; at < text.size();) {
    const size_t begin = at;
    const char32_t c = TakeCodePoint(text, at);
    const bool kept = lines && (c == '\n' || c == '\t');
    // A terminal that is not UTF-8's may obey a byte of 0x80 to 0x9f that stands alone.
    if (!kept && (c == kBroken || IsHarmful(c))) {
      harmless += '?';
    } else {
      harmless.append(text, begin, at - begin);
    }
  }
  return harmless;
}

std::string Bold(const std::string& text) {
  return HasColour() ? "\033[1m" + text + "\033[0m" : text;
}

void Table::Print() const {
  std::vector<size_t> widths(rows_[0].size(), 0);
  std::vector<bool> numbers(rows_[0].size(), rows_.size() > 1);
  for (size_t r = 0; r < rows_.size(); ++r) {
    for (size_t c = 0; c < rows_[r].size(); ++c) {
      widths[c] = std::max(widths[c], Width(rows_[r][c]));
      if (r > 0 && !IsNumber(rows_[r][c])) numbers[c] = false;
    }
  }
  for (size_t r = 0; r < rows_.size(); ++r) {
    std::string line;
    for (size_t c = 0; c < rows_[r].size(); ++c) {
      const std::string gap(widths[c] - Width(rows_[r][c]), ' ');
      line += (c == 0 ? "" : "  ") + (numbers[c] ? gap + rows_[r][c] : rows_[r][c] + gap);
    }
    line.erase(line.find_last_not_of(' ') + 1);
    std::cout << (r == 0 ? Bold(line) : line) << '\n';
  }
  std::cout.flush();
}

std::string Cell(const nlohmann::json& object, const std::string& key, int digits) {
  const auto it = object.is_object() ? object.find(key) : object.end();
  if (!object.is_object() || it == object.end() || it->is_null()) return "-";
  if (it->is_string()) {
    const std::string text = Harmless(it->get<std::string>());
    return text.empty() ? "-" : text;
  }
  if (it->is_number_float()) return absl::StrFormat("%.*f", digits, it->get<double>());
  return it->dump();
}

std::string Span(double seconds) {
  const auto whole = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
  if (whole < 60) return absl::StrCat(whole, " s");
  if (whole < 3600) return absl::StrCat(whole / 60, " min ", whole % 60, " s");
  return absl::StrCat(whole / 3600, " h ", whole / 60 % 60, " min");
}

Progress::Progress(std::string what)
    : what_(std::move(what)),
      terminal_(::isatty(STDERR_FILENO) == 1),
      start_(SystemClock().Monotonic()),
      last_(-absl::InfiniteDuration()) {}

Progress::~Progress() {
  if (drawn_) std::cerr << '\n';
}

std::string Progress::Line(int64_t done, int64_t total, const std::string& note, bool bar) const {
  std::string line = what_ + "  ";
  if (bar && total > 0) {
    constexpr int64_t kWidth = 30;
    const auto filled = static_cast<size_t>(kWidth * std::min(done, total) / total);
    line += "[" + std::string(filled, '#') + std::string(kWidth - filled, '.') + "]  ";
  }
  absl::StrAppend(&line, done, "/", total);
  const double seconds = absl::ToDoubleSeconds(SystemClock().Monotonic() - start_);
  const int64_t fresh = done - std::max<int64_t>(first_done_, 0);
  if (fresh > 0 && done < total && seconds > 0) {
    absl::StrAppend(&line, absl::StrFormat("  %.2f/min", 60.0 * static_cast<double>(fresh) / seconds),
                    "  ", Span(seconds * static_cast<double>(total - done) /
                               static_cast<double>(fresh)),
                    " left");
  }
  if (!note.empty()) absl::StrAppend(&line, "  ", Harmless(note));
  return line;
}

void Progress::Show(int64_t done, int64_t total, const std::string& note) {
  if (first_done_ < 0) first_done_ = done;
  const absl::Duration now = SystemClock().Monotonic();
  if (terminal_) {
    std::cerr << "\r\033[K" << Line(done, total, note, true) << std::flush;
    drawn_ = true;
    return;
  }
  // Only what changed: a log of an hour's waiting should stay readable.
  const std::string key = absl::StrCat(done, "/", total, note);
  if (key == last_line_ || (now - last_ < absl::Seconds(2) && done < total)) return;
  std::cerr << Line(done, total, note, false) << std::endl;
  last_line_ = key;
  last_ = now;
}

}  // namespace myograde::server
