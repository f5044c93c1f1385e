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
// within words that are longer than a piece. Pieces after the first begin with `head`, which is
// ASCII; if it is spaces, a word that does not fit behind them moves to the left, but for two.
std::vector<std::string> BreakLine(std::string_view text, size_t columns,
                                   std::string_view head = "");

// The beginning of `text` in at most `columns`, with "…" for what is cut off.
std::string CutText(std::string_view text, size_t columns);

// Standard output while a verb runs: what std::cout prints is written to descriptor 1, and the first
// failure is remembered. Lines are made harmless (server/base/plain_text.h). On a terminal, those that
// are longer than it are broken at spaces and go on below the second column of their text, or behind
// kForeignMark (text.h). At most one at a time.
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

// Standard output as it is, for what must not be changed: JSON, keys, documents.
std::ostream& PlainOutput();

// Prints one line on standard error, made harmless, and broken as by StandardOutput.
void PrintToErrors(std::string_view line);

}  // namespace myograde::server
