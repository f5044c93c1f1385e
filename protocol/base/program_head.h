// What the first bytes of a file say about how the kernel would start it.
#pragma once

#include <string>

namespace myograde {

struct ProgramHead {
  enum class Kind {
    kForeign,  // an ELF program of another processor or of another word size than this one
    kBinary,   // an ELF program for this processor
    kScript,   // begins with "#!"
    kText,     // anything else; execvp(3) hands it to /bin/sh
  };
  Kind kind = Kind::kText;
  // kScript: the program behind "#!". kBinary: the dynamic loader, "" if it needs none.
  std::string interpreter;
  std::string argument;  // kScript: what follows the interpreter on its line
  std::string processor;  // kForeign: what it is for, as "AArch64" or "32-bit x86"
};

// Reads at most a few kilobytes of the file `fd`, wherever its offset is. Anybody may have written
// the file: nothing in it is believed beyond these strings. Never fails; what can't be read is
// text.
ProgramHead ReadProgramHead(int fd);

}  // namespace myograde
