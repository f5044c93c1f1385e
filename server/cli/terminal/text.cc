#include "server/cli/terminal/terminal.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <numeric>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_split.h>

#include "server/base/counted.h"

namespace myograde::server {
namespace {

// Appends `text` as Filled makes it; false if a value was missing.
bool Fill(const Json& object, std::string_view text, std::string& filled) {
  bool whole = true;
  for (size_t open; (open = text.find_first_of("{[")) != std::string_view::npos;) {
    filled += text.substr(0, open);
    const bool optional = text[open] == '[';
    const size_t close = text.find(optional ? ']' : '}', open);
    std::string key(text.substr(open + 1, close - open - 1));
    text.remove_prefix(close + 1);
    if (optional) {
      std::string part;
      if (Fill(object, key, part)) filled += part;
      continue;
    }
    const size_t dot = key.find('.');
    const bool nested = dot != std::string::npos;
    const Json inner = nested ? object.value(key.substr(0, dot), Json::object()) : Json();
    const Json& part = nested ? inner : object;
    if (nested) key.erase(0, dot + 1);
    const size_t colon = key.find(':');
    const std::string value = Cell(part, key.substr(0, colon));
    whole = whole && value != "-";
    filled += colon == std::string::npos
                  ? value
                  : CountCell(part, key.substr(0, colon), key.substr(colon + 1).c_str());
  }
  filled += text;
  return whole;
}

constexpr size_t kGap = 2;
constexpr size_t kLeastText = 8;     // columns that a text is given at least
constexpr size_t kWholeNumber = 12;  // numbers up to so many columns are never broken

bool IsNumber(const std::string& cell) {
  return cell == "-" || (!cell.empty() && cell.find_first_not_of("0123456789.+-e%") ==
                                              std::string::npos);
}

size_t LongestWord(const std::string& text) {
  size_t longest = 0;
  for (const std::string& word : std::vector<std::string>(absl::StrSplit(text, ' '))) {
    longest = std::max(longest, TextWidth(word));
  }
  return longest;
}

size_t SumOf(const std::vector<size_t>& widths) {
  return std::accumulate(widths.begin(), widths.end(), kGap * (widths.size() - 1));
}

}  // namespace

std::string Marked(std::string_view text) {
  std::string marked;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size());
    absl::StrAppend(&marked, std::string(kForeignMark),
                    Sanitized(text.substr(at, end - at), /*tabs=*/true), "\n");
    at = end + 1;
  }
  return marked;
}

std::string Bold(const std::string& text) {
  const char* no_color = std::getenv("NO_COLOR");
  const bool plain = ::isatty(STDOUT_FILENO) != 1 || (no_color != nullptr && *no_color != '\0');
  return plain ? text : "\033[1m" + text + "\033[0m";
}

Json RowWith(const Json& rows, const char* key, const Json& value) {
  for (const Json& row : rows) {
    if (row.value(key, Json()) == value) return row;
  }
  return nullptr;
}

std::string Cell(const Json& object, const std::string& key, int digits) {
  const auto it = object.find(key);
  if (it == object.end() || it->is_null()) return "-";
  if (it->is_number_float()) return absl::StrFormat("%.*f", digits, it->get<double>());
  if (!it->is_string() && !it->is_array()) return it->dump();
  std::string text;
  for (const Json& part : it->is_array() ? *it : Json::array({*it})) {
    if (!part.is_string()) continue;
    absl::StrAppend(&text, text.empty() ? "" : ", ", Sanitized(part.get<std::string>()));
  }
  return text.empty() ? "-" : text;
}

std::string DurationText(double seconds) {
  const auto whole = static_cast<int64_t>(std::llround(std::max(0.0, seconds)));
  if (whole < 60) return absl::StrCat(whole, " s");
  if (whole < 3600) return absl::StrCat(whole / 60, " min ", whole % 60, " s");
  return absl::StrCat(whole / 3600, " h ", whole / 60 % 60, " min");
}

std::string CountCell(const Json& object, const std::string& key, const char* one) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number_integer()) {
    return absl::StrCat(Cell(object, key), " ", one, "s");
  }
  return Counted(it->get<int64_t>(), one);
}

std::string Filled(const Json& object, std::string_view text) {
  std::string filled;
  Fill(object, text, filled);
  return filled;
}

std::string HashText(const std::string& hash, bool full) {
  constexpr size_t kDigits = 12;
  return full ? hash : hash.substr(0, kDigits);
}

std::vector<Table::Column> Table::Columns() const {
  std::vector<Column> columns(rows_[0].size());
  std::vector<size_t> cells(columns.size(), 0);  // the widest but the head
  for (size_t r = 0; r < rows_.size(); ++r) {
    for (size_t c = 0; c < columns.size(); ++c) {
      const size_t width = TextWidth(rows_[r][c]);
      columns[c].width = std::max(columns[c].width, width);
      if (r == 0) continue;
      cells[c] = std::max(cells[c], width);
      columns[c].number = columns[c].number && IsNumber(rows_[r][c]);
    }
  }
  for (size_t c = 0; c < columns.size(); ++c) {
    Column& column = columns[c];
    column.number = column.number && rows_.size() > 1;
    const bool whole = column.number && cells[c] <= kWholeNumber;
    const size_t least = std::max(whole ? cells[c] : kLeastText, LongestWord(rows_[0][c]));
    column.least = std::min(column.width, least);
  }
  return columns;
}

std::vector<std::string> Table::Lines(size_t most) const {
  const std::vector<Column> columns = Columns();
  std::vector<size_t> widths;
  for (const Column& column : columns) widths.push_back(column.width);
  while (most > 0 && SumOf(widths) > most) {
    // The widest that can give way does.
    size_t chosen = columns.size();
    for (size_t c = 0; c < columns.size(); ++c) {
      if (widths[c] <= columns[c].least) continue;
      if (chosen == columns.size() || widths[c] > widths[chosen]) chosen = c;
    }
    if (chosen == columns.size()) return Blocks(most);
    --widths[chosen];
  }
  std::vector<std::string> lines;
  for (const std::vector<std::string>& row : rows_) {
    std::vector<std::vector<std::string>> cells;
    size_t height = 1;
    for (size_t c = 0; c < columns.size(); ++c) {
      cells.push_back(BreakLine(row[c], widths[c]));
      height = std::max(height, cells.back().size());
    }
    for (size_t l = 0; l < height; ++l) {
      std::string line;
      for (size_t c = 0; c < columns.size(); ++c) {
        const std::string cell = l < cells[c].size() ? cells[c][l] : "";
        const std::string rest(widths[c] - TextWidth(cell), ' ');
        if (c > 0) line.append(kGap, ' ');
        line += columns[c].number ? rest + cell : cell + rest;
      }
      line.erase(line.find_last_not_of(' ') + 1);
      lines.push_back(&row == &rows_[0] ? Bold(line) : line);
    }
  }
  return lines;
}

std::vector<std::string> Table::Blocks(size_t most) const {
  size_t heads = 0;
  for (const std::string& head : rows_[0]) heads = std::max(heads, TextWidth(head));
  const std::string indent(heads + kGap < most / 2 ? heads + kGap : kGap, ' ');
  std::vector<std::string> lines;
  for (size_t r = 1; r < rows_.size(); ++r) {
    if (r > 1) lines.emplace_back();
    for (size_t c = 0; c < rows_[r].size(); ++c) {
      const std::string& head = rows_[0][c];
      const std::string line =
          head + std::string(heads + kGap - TextWidth(head), ' ') + rows_[r][c];
      const std::vector<std::string> pieces = BreakLine(line, most, indent);
      lines.insert(lines.end(), pieces.begin(), pieces.end());
    }
  }
  return lines;
}

void Table::Print() const {
  for (const std::string& line : Lines(TerminalColumns(STDOUT_FILENO))) std::cout << line << '\n';
  std::cout.flush();
}

RowColumn::RowColumn(const char* column) {
  const std::pair<std::string, std::string> parts = absl::StrSplit(column, absl::MaxSplits('=', 1));
  *this = RowColumn(parts.first, parts.second.empty() ? parts.first : parts.second, 4);
  if (parts.second.find('{') == std::string::npos) return;
  cell = [text = parts.second](const Json& row) { return Filled(row, text); };
}

RowColumn::RowColumn(std::string head_text, std::string key, int digits)
    : RowColumn(std::move(head_text), [key = std::move(key), digits](const Json& row) {
        return Cell(row, key, digits);
      }) {}

RowColumn ColumnOfPart(std::string part, RowColumn column) {
  return {std::move(column.head),
          [part = std::move(part), cell = std::move(column.cell)](const Json& row) {
            return cell(row.value(part, Json::object()));
          }};
}

void PrintRows(const Json& rows, const std::vector<RowColumn>& columns) {
  std::vector<std::string> head;
  for (const RowColumn& column : columns) head.push_back(column.head);
  Table table(std::move(head));
  for (const Json& row : rows) {
    std::vector<std::string> cells;
    for (const RowColumn& column : columns) cells.push_back(column.cell(row));
    table.Add(std::move(cells));
  }
  table.Print();
}

}  // namespace myograde::server
