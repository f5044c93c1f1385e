// What fits on a terminal: its width, the columns of a text, lines that are broken before the
// terminal would break them, and how far something is.
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

  // `note` stands behind the counts: what is going on, in a few words. `total` 0: not known.
  // `waiting`: nothing can go on (a queue), and the time until the next call says nothing of the
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
