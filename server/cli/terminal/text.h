// Text for people: foreign lines, how values are written, and tables.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "server/base/plain_text.h"  // Harmless, which goes with these

namespace myograde::server {

using Json = nlohmann::json;  // in all of server/cli

// What lines that somebody else wrote begin with, so that none looks like a line of this program.
inline constexpr std::string_view kForeignMark = "  | ";

// Lines that somebody else wrote, such as a policy's last output: each is Harmless and begins with
// kForeignMark. Ends with a newline unless `text` is empty.
std::string Marked(std::string_view text);

// Bold on a terminal, unless NO_COLOR is set.
std::string Bold(const std::string& text);

// The string at `key` as it is; "" if there is none.
std::string TextAt(const Json& object, const char* key);

// The first of `rows`, an array of objects, with that string at `key`; null if there is none.
Json RowWith(const Json& rows, const char* key, const std::string& value);

// A JSON number, a string, or an array of strings ("a, b") as a table cell; "-" for an empty one, null
// or a missing key.
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

// The same column of the objects that stand in others at the key `part`.
RowColumn ColumnOfPart(std::string part, RowColumn column);

// Prints `rows`, an array of objects, as a table.
void PrintRows(const Json& rows, const std::vector<RowColumn>& columns);

}  // namespace myograde::server
