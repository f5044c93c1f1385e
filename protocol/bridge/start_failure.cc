#include "protocol/bridge/start_failure.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_split.h>

#include "protocol/base/fd.h"
#include "protocol/base/program_head.h"

namespace myograde::bridge {
namespace {

std::string Path() {
  const char* path = std::getenv("PATH");
  return path != nullptr ? path : "/bin:/usr/bin";
}

ProgramHead HeadOf(const std::string& path) {
  const Fd file(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  return file.valid() ? ReadProgramHead(file.get()) : ProgramHead{};
}

// Why there is nothing at `path`.
std::string Missing(const std::string& path) {
  char target[PATH_MAX];
  const ssize_t size = readlink(path.c_str(), target, sizeof(target));
  if (size <= 0) return "is not there";
  return absl::StrCat("is a symbolic link to \"",
                      absl::string_view(target, static_cast<size_t>(size)),
                      "\", which is not in the sandbox");
}

std::string Reason(const std::string& path, int error) {
  struct stat info = {};
  if (stat(path.c_str(), &info) != 0) return Missing(path);
  if (S_ISDIR(info.st_mode)) return "is a folder";
  if ((info.st_mode & 0111) == 0) return "is not executable: set its bit with chmod +x";
  const ProgramHead head = HeadOf(path);
  const bool needs = !head.interpreter.empty() && access(head.interpreter.c_str(), X_OK) != 0;
  if (head.kind == ProgramHead::Kind::kForeign) {
    return absl::StrCat("is a program for ", head.processor);
  }
  if (head.kind == ProgramHead::Kind::kScript && needs) {
    return absl::StrCat("is a script for \"", head.interpreter, "\", which ",
                        Missing(head.interpreter));
  }
  if (head.kind == ProgramHead::Kind::kBinary && needs) {
    return absl::StrCat("needs the dynamic loader \"", head.interpreter, "\", which ",
                        Missing(head.interpreter));
  }
  if (error == E2BIG) return "has more arguments or variables than fit";
  return "can't be executed";
}

}  // namespace

std::string FindProgram(const std::string& word) {
  if (word.find('/') != std::string::npos) return word;
  for (const absl::string_view folder : absl::StrSplit(Path(), ':')) {
    const std::string place = absl::StrCat(folder.empty() ? "." : folder, "/", word);
    if (access(place.c_str(), F_OK) == 0) return place;
  }
  return "";
}

bool IsForeignProgram(const std::string& path) {
  return HeadOf(path).kind == ProgramHead::Kind::kForeign;
}

std::string ExplainStart(const std::string& word, int error) {
  const std::string path = FindProgram(word);
  const std::string reason =
      path.empty() ? absl::StrCat("is in none of the folders ", Path()) : Reason(path, error);
  return absl::StrCat("the policy's command could not be started: \"", word, "\" ", reason, " (",
                      strerror(error), ")");
}

}  // namespace myograde::bridge
