// What people see: how values are written, foreign lines and tables, what fits on a terminal,
// standard output, and progress.
#pragma once

#include <absl/time/time.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "server/base/json_value.h"
#include "server/base/plain_text.h"  // Sanitized, which goes with these

namespace myograde::server {

using Json = nlohmann::json;  // in all of server/cli

// What lines that somebody else wrote begin with, so that none looks like a line of this program.
inline constexpr std::string_view kForeignMark = "  | ";

// Lines that somebody else wrote, such as a policy's last output: each is Sanitized and begins with
// kForeignMark. Ends with a newline unless `text` is empty.
std::string Marked(std::string_view text);

// Bold on a terminal, unless NO_COLOR is set.
std::string Bold(const std::string& text);

// The first of `rows`, an array of objects, with that value at `key`; null if there is none.
Json RowWith(const Json& rows, const char* key, const Json& value);

// A JSON number, a string, or an array of strings ("a, b") as a table cell; "-" for an empty one,
// null or a missing key.
std::string Cell(const Json& object, const std::string& key, int digits = 4);

// A JSON count with its word (counted.h): "1 episode"; "- episodes" for null or a missing key.
std::string CountCell(const Json& object, const std::string& key, const char* one);

// `text`, which is this program's own, with the Cell of `object` in place of "{key}", its CountCell
// in place of "{key:word}", and that of the object in it in place of "{part.key}". What stands in
// brackets is left out if a value in it is missing or null.
std::string Filled(const Json& object, std::string_view text);

// 75 -> "1 min 15 s".
std::string DurationText(double seconds);

// The first digits of a hash, or all of them if `full`.
std::string HashText(const std::string& hash, bool full);

// Columns as wide as their widest cell; numbers to the right. The first row is the head. On a
// terminal that is too narrow, cells go on below themselves, and where even that does not
// help each row becomes a block of lines, "head: cell".
class Table {
 public:
  explicit Table(std::vector<std::string> head) { rows_.push_back(std::move(head)); }
  void Add(std::vector<std::string> row) { rows_.push_back(std::move(row)); }
  void Print() const;

  // The lines of the table, the head's first, in at most `columns` (0: as many as it takes).
  std::vector<std::string> Lines(size_t columns) const;

 private:
  struct Column {
    size_t width = 0;  // of the widest cell
    size_t least = 0;  // that it may be narrowed to
    bool number = true;
  };
  std::vector<Column> Columns() const;
  std::vector<std::string> Blocks(size_t columns) const;

  std::vector<std::vector<std::string>> rows_;
};

// A column of a table of JSON objects: what it says of each.
struct RowColumn {
  // "HEAD=KEY", or a key that is the head, too: its cells are Cell of the key. "HEAD=TEXT" with a
  // "{" in the text: they are Filled.
  RowColumn(const char* column);  // NOLINT: tables are lists of them
  RowColumn(std::string head_text, std::string key, int digits);
  RowColumn(std::string head_text, std::function<std::string(const Json& row)> cell_of)
      : head(std::move(head_text)), cell(std::move(cell_of)) {}

  std::string head;
  std::function<std::string(const Json& row)> cell;
};

// The same column for objects at the key `part` of others.
RowColumn ColumnOfPart(std::string part, RowColumn column);

// Prints `rows`, an array of objects, as a table.
void PrintRows(const Json& rows, const std::vector<RowColumn>& columns);

// Columns of the terminal behind a descriptor; 0 if there is none.
size_t TerminalColumns(int fd);

// Columns that UTF-8 text takes: two for wide characters, none for marks that join the one
// before and for the escape sequences of Bold.
size_t TextWidth(std::string_view text);

// `text`, one line, in pieces of at most `columns` (2 at least): broken at spaces, which go, or
// within words that are longer than a piece. Pieces after the first begin with `head`, which is
// ASCII; if it is spaces, a word that does not fit behind them moves to the left, but for two.
std::vector<std::string> BreakLine(std::string_view text, size_t columns,
                                   std::string_view head = "");

// The beginning of `text` in at most `columns`, with "…" for what is cut off.
std::string CutText(std::string_view text, size_t columns);

// Standard output while a verb runs: what std::cout prints is written to descriptor 1, and the first
// failure is remembered. Lines are sanitized (server/base/plain_text.h). On a terminal, those that
// are too long for it are broken at spaces and continue below the second column of their text, or
// after kForeignMark. At most one at a time.
class StandardOutput {
 public:
  StandardOutput();
  ~StandardOutput();
  StandardOutput(const StandardOutput&) = delete;
  StandardOutput& operator=(const StandardOutput&) = delete;

 private:
  class Writer;
  class Fitter;
  std::unique_ptr<Writer> writer_;
  std::unique_ptr<Fitter> fitter_;
  std::streambuf* before_;
};

// Writes what std::cout still holds. The errno of the first write that failed since the
// StandardOutput was made, 0 if all of its bytes were taken.
int FlushStandardOutput();

// Standard output without changes to what is printed: for JSON, keys, documents.
std::ostream& PlainOutput();

// Prints one line on standard error, sanitized and broken as by StandardOutput.
void PrintToErrors(std::string_view line);

// A line on standard error: drawn over on a terminal, in which it always fits; elsewhere lines
// of their own, one each 2 s at most.
class Progress {
 public:
  enum class Unit {
    kEpisodes,  // the last line stays
    kBytes,     // shown only if it takes a while, and gone in the end
  };
  explicit Progress(std::string what, Unit unit = Unit::kEpisodes);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `note` follows the counts: what is going on, in a few words. `total` 0: not known.
  // `waiting`: nothing can proceed (a queue), so the time until the next call does not count for the
  // pace.
  void Show(int64_t done, int64_t total, const std::string& note, bool waiting = false);

  // Calls Show, with the note `at_end` once all is done. This object must outlive it.
  std::function<void(int64_t done, int64_t total)> Listener(std::string at_end = "") {
    return [this, at_end = std::move(at_end)](int64_t done, int64_t total) {
      Show(done, total, done < total ? "" : at_end);
    };
  }

 private:
  std::string Line(int64_t done, int64_t total, const std::string& note, absl::Duration now,
                   size_t columns) const;

  const std::string what_;
  const Unit unit_;
  const bool terminal_;
  // Moments of the monotonic clock.
  const absl::Duration begun_;
  bool drawn_ = false;
  absl::Duration last_ = -absl::InfiniteDuration();  // something was printed
  std::string last_key_;
  // The pace: since first_ at first_done_, measured when the count last rose.
  absl::Duration first_;
  absl::Duration risen_;
  int64_t first_done_ = -1;
  int64_t risen_done_ = -1;
};

}  // namespace myograde::server
