#include "server/cli/terminal/terminal.h"

#include <sys/ioctl.h>
#include <unistd.h>
#include <wchar.h>
#include <wctype.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <iostream>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>

#include "protocol/base/clock.h"

namespace myograde::server {
namespace {

constexpr size_t kDefaultColumns = 80;  // of a terminal that does not tell
constexpr size_t kFewestColumns = 20;
constexpr size_t kTabColumns = 8;  // at most
// What goes on stands to the right of where this program's lines begin.
constexpr size_t kLeastIndent = 2;
constexpr std::string_view kBoldOn = "\033[1m";
constexpr std::string_view kBoldOff = "\033[0m";

// The piece of text at `at`, which goes behind it: a code point or an escape sequence, and
// the columns that it takes.
struct Glyph {
  std::string_view bytes;
  size_t columns = 0;
  bool space = false;
};

// Spaces that forbid a break, too: with them foreign text could choose what a line begins with.
bool IsSpace(char32_t c) {
  return ::iswspace(static_cast<wint_t>(c)) != 0 || c == 0xa0 || c == 0x2007 || c == 0x202f;
}

Glyph TakeGlyph(std::string_view text, size_t& at) {
  const size_t begin = at;
  if (text[at] == '\033' && at + 1 < text.size() && text[at + 1] == '[') {
    at = text.find_first_not_of("0123456789;", at + 2);
    at = at == std::string_view::npos ? text.size() : at + 1;
    return {text.substr(begin, at - begin), 0};
  }
  const char32_t c = TakeCodePoint(text, at);
  // -1 for what the C library does not know; a terminal shows something in its place.
  const int columns = c == kBroken ? 1 : ::wcwidth(static_cast<wchar_t>(c));
  return {text.substr(begin, at - begin),
          c == '\t' ? kTabColumns : static_cast<size_t>(columns < 0 ? 1 : columns), IsSpace(c)};
}

// The spaces at `at`, or what stands there up to the next one; goes behind it.
std::string_view TakeRun(std::string_view text, bool spaces, size_t& at) {
  const size_t begin = at;
  for (size_t next = at; next < text.size(); at = next) {
    if (TakeGlyph(text, next).space != spaces) break;
  }
  return text.substr(begin, at - begin);
}

// Where a broken line goes on: below the second column of a text that has two, else a little
// to the right of its beginning.
size_t CountIndent(std::string_view line, size_t columns) {
  const size_t begin = std::min(line.find_first_not_of(' '), line.size());
  const size_t gap = line.find("  ", begin);
  if (gap != std::string_view::npos) {
    const size_t second = line.find_first_not_of(' ', gap);
    if (second != std::string_view::npos) {
      const size_t column = TextWidth(line.substr(0, second));
      if (column <= columns / 2) return column;
    }
  }
  return begin + kLeastIndent <= columns / 2 ? begin + kLeastIndent : kLeastIndent;
}

// A line to show: harmless but for what Bold (terminal.h) adds.
std::string Shown(std::string_view line) {
  std::string shown;
  for (;;) {
    const size_t at = std::min({line.find(kBoldOn), line.find(kBoldOff), line.size()});
    shown += Sanitized(line.substr(0, at), /*tabs=*/true);
    if (at == line.size()) return shown;
    const std::string_view code = line.substr(at).starts_with(kBoldOn) ? kBoldOn : kBoldOff;
    shown += code;
    line.remove_prefix(at + code.size());
  }
}

std::streambuf* g_plain = nullptr;  // below what breaks lines, while there is a StandardOutput
int g_error = 0;                    // of the first write that failed

constexpr absl::Duration kRedraw = absl::Milliseconds(100);
constexpr absl::Duration kBetweenLines = absl::Seconds(2);
constexpr absl::Duration kBetweenByteLines = absl::Seconds(10);
constexpr absl::Duration kShortBytes = absl::Seconds(1);  // who takes no longer is not shown
constexpr size_t kWidestBar = 30;
constexpr size_t kNarrowestBar = 10;
constexpr size_t kNarrowestNote = 8;

std::string Bytes(int64_t bytes) {
  const auto value = static_cast<double>(bytes);
  if (value >= 1e9) return absl::StrFormat("%.2f GB", value / 1e9);
  if (value >= 1e6) return absl::StrFormat("%.1f MB", value / 1e6);
  return absl::StrFormat("%.0f kB", value / 1e3);
}

}  // namespace

size_t TerminalColumns(int fd) {
  if (::isatty(fd) != 1) return 0;
  winsize size = {};
  if (::ioctl(fd, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return kDefaultColumns;
  return std::max<size_t>(size.ws_col, kFewestColumns);
}

size_t TextWidth(std::string_view text) {
  size_t width = 0;
  for (size_t at = 0; at < text.size();) width += TakeGlyph(text, at).columns;
  return width;
}

std::vector<std::string> BreakLine(std::string_view text, size_t columns, std::string_view head) {
  // A head of spaces gives way to a long word.
  const bool blank = head.find_first_not_of(' ') == std::string_view::npos;
  const size_t least = blank ? std::min(head.size(), kLeastIndent) : head.size();
  size_t at = text.starts_with(head) ? head.size() : 0;
  std::vector<std::string> pieces = {std::string(text.substr(0, at))};
  size_t used = at;         // columns of the last piece
  bool has_words = false;  // the last piece; spaces in front of a line are no place to break it
  while (at < text.size()) {
    size_t next = at;
    const size_t gap = TextWidth(TakeRun(text, /*spaces=*/true, at));
    const std::string_view word = TakeRun(text, /*spaces=*/false, at);
    const size_t width = TextWidth(word);
    if (has_words && used + gap + width > columns && width + least <= columns) {
      const size_t left = std::min(head.size(), columns - width);
      pieces.push_back(absl::StrCat(std::string(head.substr(0, left)), std::string(word)));
      used = left + width;
      continue;
    }
    has_words = true;
    while (next < at) {
      const Glyph glyph = TakeGlyph(text, next);
      if (used + glyph.columns > columns) {
        if (glyph.space) continue;
        pieces.back().resize(pieces.back().find_last_not_of(' ') + 1);
        pieces.emplace_back(head);
        used = head.size();
      }
      pieces.back() += glyph.bytes;
      used += glyph.columns;
    }
  }
  return pieces;
}

std::string CutText(std::string_view text, size_t columns) {
  if (TextWidth(text) <= columns) return std::string(text);
  if (columns == 0) return "";
  std::string cut;
  size_t used = 0;
  for (size_t at = 0; at < text.size();) {
    const Glyph glyph = TakeGlyph(text, at);
    if (used + glyph.columns > columns - 1) break;
    cut += glyph.bytes;
    used += glyph.columns;
  }
  return cut + "…";
}

// Descriptor 1, with a buffer.
class StandardOutput::Writer : public std::streambuf {
 public:
  Writer() { setp(buffer_.data(), buffer_.data() + buffer_.size()); }

 protected:
  int overflow(int c) override {
    if (sync() != 0) return traits_type::eof();
    if (c != traits_type::eof()) sputc(static_cast<char>(c));
    return traits_type::not_eof(c);
  }

  int sync() override {
    const char* at = pbase();
    while (at < pptr() && g_error == 0) {
      const ssize_t written = ::write(STDOUT_FILENO, at, static_cast<size_t>(pptr() - at));
      if (written >= 0) {
        at += written;
      } else if (errno != EINTR) {
        g_error = errno;
      }
    }
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return g_error == 0 ? 0 : -1;
  }

 private:
  std::array<char, 16384> buffer_;
};

// Keeps a line until its end is there, then hands it on, made harmless, and on a terminal in pieces
// that fit.
class StandardOutput::Fitter : public std::streambuf {
 public:
  explicit Fitter(std::streambuf* below) : below_(below) {}

  void EndLine(bool newline) {
    line_ = Shown(line_);
    const size_t columns = TerminalColumns(STDOUT_FILENO);
    if (columns > 0 && TextWidth(line_) > columns) {
      const std::string head = line_.starts_with(kForeignMark)
                                   ? std::string(kForeignMark)
                                   : std::string(CountIndent(line_, columns), ' ');
      line_ = absl::StrJoin(BreakLine(line_, columns, head), "\n");
    }
    if (newline) line_ += '\n';
    below_->sputn(line_.data(), static_cast<std::streamsize>(line_.size()));
    line_.clear();
  }

 protected:
  int overflow(int c) override {
    if (c == traits_type::eof()) return traits_type::not_eof(c);
    if (c == '\n') {
      EndLine(/*newline=*/true);
    } else {
      line_ += static_cast<char>(c);
    }
    return c;
  }
  int sync() override {
    // On a terminal it waits for its end, which decides where it is broken.
    if (!line_.empty() && TerminalColumns(STDOUT_FILENO) == 0) EndLine(/*newline=*/false);
    return below_->pubsync();
  }

 private:
  std::streambuf* below_;
  std::string line_;
};

StandardOutput::StandardOutput()
    : writer_(std::make_unique<Writer>()),
      fitter_(std::make_unique<Fitter>(writer_.get())),
      before_(std::cout.rdbuf(fitter_.get())) {
  g_error = 0;
  g_plain = writer_.get();
}

StandardOutput::~StandardOutput() {
  fitter_->EndLine(/*newline=*/false);
  FlushStandardOutput();
  std::cout.rdbuf(before_);
  g_plain = nullptr;
}

int FlushStandardOutput() {
  std::cout.flush();
  if (g_plain != nullptr) g_plain->pubsync();
  return g_error;
}

std::ostream& PlainOutput() {
  if (g_plain == nullptr) return std::cout;
  static std::ostream plain(nullptr);
  plain.rdbuf(g_plain);
  return plain;
}

void PrintToErrors(std::string_view line) {
  const std::string shown = Sanitized(line);
  const size_t columns = TerminalColumns(STDERR_FILENO);
  if (columns == 0) {
    std::cerr << shown << std::endl;
    return;
  }
  const std::string indent(kLeastIndent, ' ');
  for (const std::string& piece : BreakLine(shown, columns, indent)) std::cerr << piece << '\n';
  std::cerr.flush();
}

Progress::Progress(std::string what, Unit unit)
    : what_(Sanitized(what)),
      unit_(unit),
      terminal_(::isatty(STDERR_FILENO) == 1),
      begun_(SystemClock().Monotonic()) {}

Progress::~Progress() {
  if (!drawn_) return;
  std::cerr << (unit_ == Unit::kBytes ? "\r\033[K" : "\n") << std::flush;
}

std::string Progress::Line(int64_t done, int64_t total, const std::string& note, absl::Duration now,
                           size_t columns) const {
  const bool bytes = unit_ == Unit::kBytes;
  const std::string counts = !bytes      ? absl::StrCat(done, "/", total)
                             : total > 0 ? absl::StrCat(Bytes(done), " of ", Bytes(total))
                                         : Bytes(done);
  // The pace, and "3 min left" as of the last change, less what has gone by; "" if nothing is
  // known.
  std::string rate;
  std::string left;
  const auto fresh = static_cast<double>(risen_done_ - first_done_);
  const double spent = absl::ToDoubleSeconds(risen_ - first_);
  if (fresh > 0 && spent > 0) {
    rate = bytes ? Bytes(static_cast<int64_t>(fresh / spent)) + "/s"
                 : absl::StrFormat("%.2f/min", 60 * fresh / spent);
  }
  if (fresh > 0 && done < total) {
    const double seconds = spent / fresh * static_cast<double>(total - risen_done_) -
                           absl::ToDoubleSeconds(now - risen_);
    // Later than thought: how much, the next one that ends will tell.
    if (seconds >= 1) left = DurationText(seconds) + " left";
  }
  std::string said = Sanitized(note);
  std::string bar;
  if (columns > 0) {
    // By importance: what and how many, how long, the note, the bar, the pace.
    const auto taken = [](const std::string& part) {
      return part.empty() ? 0 : TextWidth(part) + 2;
    };
    size_t room = columns - std::min(columns, TextWidth(what_) + taken(counts));
    if (taken(left) > room) left.clear();
    room -= taken(left);
    said = room < kNarrowestNote + 2 ? "" : CutText(said, room - 2);
    room -= taken(said);
    if (total > 0 && room >= kNarrowestBar + 4) {
      const size_t width = std::min(kWidestBar, room - 4);
      const auto filled = static_cast<size_t>(static_cast<int64_t>(width) *
                                              std::clamp<int64_t>(done, 0, total) / total);
      bar = "[" + std::string(filled, '#') + std::string(width - filled, '.') + "]";
    }
    room -= taken(bar);
    if (taken(rate) > room) rate.clear();
  }
  std::string line = what_;
  for (const std::string& part : {bar, counts, rate, left, said}) {
    if (!part.empty()) absl::StrAppend(&line, "  ", part);
  }
  return columns > 0 ? CutText(line, columns) : line;
}

void Progress::Show(int64_t done, int64_t total, const std::string& note, bool waiting) {
  const absl::Duration now = SystemClock().Monotonic();
  if (first_done_ < 0 || waiting) {
    first_ = risen_ = now;
    first_done_ = risen_done_ = done;
  } else if (done > risen_done_) {
    risen_ = now;
    risen_done_ = done;
  }
  if (unit_ == Unit::kBytes && now - begun_ < kShortBytes) return;
  const std::string key = absl::StrCat(done, "/", total, note);
  if (terminal_) {
    if (now - last_ < kRedraw && done < total) return;
    // The last column stays free: a terminal would begin a new line behind it.
    std::cerr << "\r\033[K" << Line(done, total, note, now, TerminalColumns(STDERR_FILENO) - 1)
              << std::flush;
    drawn_ = true;
  } else {
    // Only what changed: a log of an hour's waiting should stay readable.
    const absl::Duration between = unit_ == Unit::kBytes ? kBetweenByteLines : kBetweenLines;
    if (key == last_key_ || (now - last_ < between && done < total)) return;
    if (unit_ == Unit::kBytes && now - begun_ < between) return;
    std::cerr << Line(done, total, note, now, 0) << std::endl;
    last_key_ = key;
  }
  last_ = now;
}

}  // namespace myograde::server
