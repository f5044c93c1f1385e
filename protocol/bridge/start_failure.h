// What to tell the author of a policy whose command could not be executed.
#pragma once

#include <string>

namespace myograde::bridge {

// Where execvp(3) finds a program: `word` itself if it has a slash, else the first file of that
// name on the PATH; "" if there is none.
std::string FindProgram(const std::string& word);

// True for a program of another processor, which must not be handed to a shell as a script.
bool IsForeignProgram(const std::string& path);

// One sentence on why `word` could not be executed, as execvp(3) says with `error`: it names the
// file that is missing or wrong, be it the program, its interpreter or its dynamic loader.
std::string ExplainStart(const std::string& word, int error);

}  // namespace myograde::bridge
