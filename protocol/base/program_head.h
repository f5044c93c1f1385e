// How the kernel would start a file, judging by its first bytes.
#pragma once

#include <string>

namespace myograde {

struct ProgramHead {
  enum class Kind {
    kForeign,  // an ELF program for another processor or word size
    kBinary,   // an ELF program for this processor
    kScript,   // begins with "#!"
    kText,     // anything else; execvp(3) hands it to /bin/sh
  };
  Kind kind = Kind::kText;
  // kScript: the program after "#!". kBinary: the dynamic loader, "" if it needs none.
  std::string interpreter;
  std::string argument;  // kScript: the rest of the line after the interpreter
  bool windows_line_end = false;  // kScript: of its first line; the kernel takes the CR for a part of it
  std::string processor;  // kForeign: what it is for, as "AArch64" or "32-bit x86"
};

// Completes "NAME, which" of a script with `windows_line_end`.
inline constexpr char kWindowsLineEnds[] =
    "is a script with the line ends of Windows, so its first line names no program; save it with those of "
    "Unix (LF; \"dos2unix\" does that)";

// Reads at most a few kilobytes of the file `fd`, whatever its offset. The file is untrusted: its
// content affects nothing but these strings. Never fails; an unreadable file is kText.
ProgramHead ReadProgramHead(int fd);

}  // namespace myograde
