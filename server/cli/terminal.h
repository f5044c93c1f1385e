// Text for people: tables, progress, colour.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <absl/time/time.h>
#include <nlohmann/json.hpp>

namespace myograde::server {

// `text` without what a terminal would obey, or what would turn or hide the words
// around it (plain_text.h): that becomes '?'; newlines and tabs stay if `lines`.
std::string Harmless(std::string_view text, bool lines = false);

// Bold on a terminal, unless NO_COLOR is set.
std::string Bold(const std::string& text);

// Columns as wide as their widest cell; numbers to the right. The first row is the head.
class Table {
 public:
  explicit Table(std::vector<std::string> head) { rows_.push_back(std::move(head)); }
  void Add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  void Print() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

// A JSON number or string as a table cell; "-" for null or a missing key.
std::string Cell(const nlohmann::json& object, const std::string& key, int digits = 4);

// 75 -> "1 min 15 s".
std::string Span(double seconds);

// How far something is: a bar that is drawn over on a terminal (standard
// error), plain lines elsewhere, at most one each 2 s.
class Progress {
 public:
  explicit Progress(std::string what);
  ~Progress();
  // `note` stands behind the counts: what is going on, in a few words.
  void Show(int64_t done, int64_t total, const std::string& note);

 private:
  std::string Line(int64_t done, int64_t total, const std::string& note, bool bar) const;

  std::string what_;
  bool terminal_;
  bool drawn_ = false;
  absl::Duration start_;  // moments of the monotonic clock
  absl::Duration last_;
  int64_t first_done_ = -1;
  std::string last_line_;
};

}  // namespace myograde::server
