// Tables of text for people.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "server/cli/terminal/text.h"

namespace myograde::server {

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
  // "HEAD=KEY", or a key that is the head, too: its cells are Cell (text.h) of the key.
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
