// policy.json of a submission, in a folder with a program, links and data.
#include <fcntl.h>
#include <sys/stat.h>

#include "protocol/base/fd.h"
#include "server/artefact/submission.h"
#include "server/sandbox/program.h"
#include "tests/fuzz/fuzz.h"

using namespace myograde;
using fuzz::Require;

namespace {

const fuzz::Folder& Submission() {
  static const fuzz::Folder folder;
  static const bool filled = [] {
    namespace fs = std::filesystem;
    fuzz::WriteFile(folder / "policy", "#!/bin/sh\n");
    fuzz::WriteFile(folder / "data", "no program");
    fs::create_directory(folder / "bin");
    fs::create_symlink("../policy", folder / "bin/up");
    fs::create_symlink("policy", folder / "link");
    fs::create_symlink("loop", folder / "loop");
    fs::create_symlink("/usr/bin/python3", folder / "python3");
    fs::create_symlink("/", folder / "root");
    return ::chmod((folder / "policy").c_str(), 0755) == 0;
  }();
  Require(filled, "a submission can be made");
  return folder;
}

}  // namespace

MYOGRADE_FUZZ_TARGET(manifest)(const uint8_t* data, size_t size) {
  fuzz::WriteFile(Submission() / "policy.json", {reinterpret_cast<const char*>(data), size});
  const Fd folder(::open(Submission().path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  const auto submitted = server::ReadSubmittedManifest(folder.get());
  if (!submitted.ok()) {
    Require(absl::IsInvalidArgument(submitted.status()), "a bad manifest is the participant's");
    Require(submitted.status().message().find('\n') == absl::string_view::npos,
            "a refusal is one line");
    return 0;
  }
  const PolicyManifest* manifest = &submitted->manifest;
  Require(!manifest->name.empty() && manifest->name.size() <= 64, "a name has 1 to 64 bytes");
  Require(!manifest->command.empty(), "there is a command");
  for (const std::string& word : manifest->command) {
    Require(word.find('\0') == std::string::npos, "a word of a command is a C string");
  }
  const std::string& program = manifest->command[0];
  std::error_code ignored;
  Require(program.find('/') != std::string::npos ||
              !std::filesystem::is_regular_file(Submission() / program, ignored),
          "what the PATH is asked for is no file of the submission");
  const absl::Status starts = server::CheckProgram(*manifest, Submission().path().string(), {});
  Require(starts.ok() || absl::IsInvalidArgument(starts), "a bad command is the participant's");
  for (const auto& [name, value] : manifest->environment) {
    Require(!name.empty() && name.find('=') == std::string::npos &&
                value.find('\0') == std::string::npos && !name.starts_with("MYOGRADE") &&
                name != "GLIBC_TUNABLES" && name != "PATH",
            "a variable is the policy's own");
  }
  for (const std::string& runtime : manifest->runtimes) {
    Require(!runtime.empty() && runtime.find('/') == std::string::npos, "a runtime is a name");
  }
  return 0;
}
