// What fits on a terminal: its width, the columns of a text, and lines that are broken
// before the terminal would break them.
#pragma once

#include <cstddef>
#include <memory>
#include <ostream>
#include <string>
#include <string_view>
#include <vector>

namespace myograde::server {

// Columns of the terminal behind a descriptor; 0 if there is none.
size_t TerminalColumns(int fd);

// Columns that UTF-8 text takes: two for wide characters, none for marks that join the one
// before and for the escape sequences of Bold.
size_t TextWidth(std::string_view text);

// `text`, one line, in pieces of at most `columns` (2 at least): broken at spaces, which go, or
// within words that are longer than a piece. Pieces after the first begin with `indent` spaces.
std::vector<std::string> BreakLine(std::string_view text, size_t columns, size_t indent = 0);

// The beginning of `text` in at most `columns`, with "…" for what is cut off.
std::string CutText(std::string_view text, size_t columns);

// While it lives, lines of standard output that are longer than the terminal are broken at
// spaces and go on below the second column of their text. Does nothing if standard output is
// no terminal. At most one at a time.
class FittedOutput {
 public:
  FittedOutput();
  ~FittedOutput();
  FittedOutput(const FittedOutput&) = delete;
  FittedOutput& operator=(const FittedOutput&) = delete;

 private:
  class Buffer;
  std::unique_ptr<Buffer> buffer_;
};

// Standard output as it is, for what must not be broken: JSON, keys, documents.
std::ostream& PlainOutput();

// Prints one line on standard error, broken as by FittedOutput.
void PrintToErrors(std::string_view line);

}  // namespace myograde::server
