// Explains to a policy's author why the command could not be executed.
#pragma once

#include <string>

namespace myograde::bridge {

// Where execvp(3) finds a program: `word` itself if it has a slash, else the first file of that
// name in PATH; "" if there is none.
std::string FindProgram(const std::string& word);

// True for a program for another processor, which must not be passed to a shell as a script.
bool IsForeignProgram(const std::string& path);

// One sentence on why execvp(3) failed with `error` for `word`. Names the file that is missing or
// wrong: the program, its interpreter or its dynamic loader.
std::string ExplainStart(const std::string& word, int error);

}  // namespace myograde::bridge
