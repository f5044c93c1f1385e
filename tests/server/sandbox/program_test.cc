// What can start in a policy's sandbox, determined without starting it.
#include "server/sandbox/program.h"

#include <elf.h>
#include <sys/stat.h>

#include <cstring>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class ProgramTest : public ::testing::Test {
 protected:
  void Write(const std::string& path, const std::string& content, mode_t mode = 0755) {
    const std::string place = folder_ / path;
    fs::create_directories(fs::path(place).parent_path());
    std::ofstream(place, std::ios::binary) << content;
    ASSERT_EQ(::chmod(place.c_str(), mode), 0);
  }
  void Link(const std::string& path, const std::string& target) {
    fs::create_directories(fs::path(folder_ / path).parent_path());
    fs::create_symlink(target, folder_ / path);
  }
  // "" if it can start.
  std::string Complaint(const std::string& word) {
    PolicyManifest manifest;
    manifest.command = {word};
    manifest.image = image_;
    const absl::Status status = CheckProgram(manifest, folder_.path().string(), runtimes_);
    EXPECT_TRUE(status.ok() || absl::IsInvalidArgument(status)) << status;
    return std::string(status.message());
  }
  // The head of an ELF program for `machine`, with `loader` if given.
  static std::string Elf(Elf64_Half machine, unsigned char word_size, const std::string& loader) {
    Elf64_Ehdr header = {};
    std::memcpy(header.e_ident, ELFMAG, SELFMAG);
    header.e_ident[EI_CLASS] = word_size;
    header.e_machine = machine;
    header.e_phoff = sizeof(header);
    header.e_phnum = loader.empty() ? 0 : 1;
    Elf64_Phdr segment = {};
    segment.p_type = PT_INTERP;
    segment.p_offset = sizeof(header) + sizeof(segment);
    segment.p_filesz = loader.size() + 1;
    std::string bytes(reinterpret_cast<const char*>(&header), sizeof(header));
    bytes.append(reinterpret_cast<const char*>(&segment), sizeof(segment));
    return bytes + loader + '\0';
  }

  const TestFolder folder_;
  std::vector<std::string> runtimes_;
  std::optional<PolicyImage> image_;
};

TEST_F(ProgramTest, ABareWordIsLookedUpOnThePath) {
  EXPECT_EQ(Complaint("sh"), "");
  EXPECT_EQ(Complaint("env"), "");
  EXPECT_THAT(Complaint("no-such-program"),
              HasSubstr("\"no-such-program\", which is neither a file of the submission nor a "
                        "program of the sandbox, which has programs in /usr/local/bin, /usr/bin, "
                        "/bin"));
}

TEST_F(ProgramTest, ARuntimeBringsPrograms) {
  const TestFolder runtime;
  runtimes_ = {runtime.path().string()};
  EXPECT_THAT(Complaint("snake"), HasSubstr(runtime / "bin"));
  fs::create_directory(runtime / "bin");
  std::ofstream(runtime / "bin/snake") << "#!/bin/sh\n";
  EXPECT_THAT(Complaint("snake"), HasSubstr("nor a program of the sandbox"));  // not executable yet
  ASSERT_EQ(::chmod((runtime / "bin/snake").c_str(), 0755), 0);
  EXPECT_EQ(Complaint("snake"), "");
  EXPECT_EQ(Complaint(runtime / "bin/snake"), "");
}

TEST_F(ProgramTest, PathsAreThoseOfTheSandbox) {
  Write("bin/policy", "#!/bin/sh\n");
  Write("data", "weights", 0644);
  EXPECT_EQ(Complaint("./bin/policy"), "");
  EXPECT_EQ(Complaint("/policy/bin/policy"), "");
  EXPECT_EQ(Complaint("/bin/sh"), "");
  EXPECT_EQ(Complaint("/usr/bin/env"), "");
  EXPECT_THAT(Complaint("/usr/bin/no-such-python"), HasSubstr("does not exist: the sandbox has"));
  // Exists on the host but not in the sandbox.
  EXPECT_THAT(Complaint("/etc/passwd"), HasSubstr("does not exist"));
  EXPECT_THAT(Complaint(folder_ / "bin/policy"), HasSubstr("leads to"));
  EXPECT_THAT(Complaint("/usr"), HasSubstr("is a folder"));
  EXPECT_THAT(Complaint("./data"), HasSubstr("is not executable; set its bit with chmod +x"));
}

TEST_F(ProgramTest, LinksAreFollowedToWhatTheSandboxHas) {
  Link("good", "/usr/bin/env");
  Link("bad", "/home/somebody/bin/python3.11");
  Link("a/chain", "link");
  Link("a/link", "/policy/good");
  Link("loop", "loop");
  EXPECT_EQ(Complaint("./good"), "");
  EXPECT_EQ(Complaint("a/chain"), "");
  EXPECT_THAT(Complaint("./bad"),
              HasSubstr("\"./bad\", which leads to \"/home\", which the sandbox does not have"));
  EXPECT_NE(Complaint("./loop"), "");
}

TEST_F(ProgramTest, AScriptNeedsItsInterpreter) {
  Write("shell", "#!/bin/sh\nexit 0\n");
  Write("elsewhere", "#!/opt/conda/bin/python3 -u\n");
  Write("found", "#!/usr/bin/env sh\n");
  Write("lost", "#!/usr/bin/env no-such-python\n");
  Write("twice", "#!/policy/elsewhere\n");
  EXPECT_EQ(Complaint("./shell"), "");
  EXPECT_EQ(Complaint("./found"), "");
  EXPECT_THAT(Complaint("./elsewhere"),
              HasSubstr("is a script for \"/opt/conda/bin/python3\", which"));
  EXPECT_THAT(Complaint("./lost"), HasSubstr("is a script for \"no-such-python\""));
  EXPECT_THAT(Complaint("./twice"), HasSubstr("\"/opt/conda/bin/python3\""));
  Write("windows", "#!/usr/bin/env sh\r\nexit 0\r\n");
  Write("inner", "#!/policy/windows\n");
  EXPECT_THAT(Complaint("./windows"), HasSubstr("line ends of Windows"));
  EXPECT_THAT(Complaint("./inner"), HasSubstr("is a script for \"/policy/windows\", which is a script with"));
}

TEST_F(ProgramTest, ABinaryNeedsThisProcessorAndItsLoader) {
#if defined(__x86_64__)
  constexpr Elf64_Half kHere = EM_X86_64;
  constexpr Elf64_Half kOther = EM_AARCH64;
  constexpr char kOtherName[] = "AArch64";
#else
  constexpr Elf64_Half kHere = EM_AARCH64;
  constexpr Elf64_Half kOther = EM_X86_64;
  constexpr char kOtherName[] = "x86-64";
#endif
  Write("static", Elf(kHere, ELFCLASS64, ""));
  Write("shell-loader", Elf(kHere, ELFCLASS64, "/bin/sh"));
  Write("alpine", Elf(kHere, ELFCLASS64, "/lib/ld-no-such-libc.so.1"));
  Write("other", Elf(kOther, ELFCLASS64, ""));
  Write("narrow", Elf(EM_386, ELFCLASS32, ""));
  Write("cut", std::string(ELFMAG) + "xx");
  EXPECT_EQ(Complaint("./static"), "");
  EXPECT_EQ(Complaint("./shell-loader"), "");
  EXPECT_EQ(Complaint("./cut"), "");
  EXPECT_THAT(Complaint("./alpine"),
              HasSubstr("needs the dynamic loader \"/lib/ld-no-such-libc.so.1\""));
  EXPECT_THAT(Complaint("./other"), HasSubstr(std::string("is a program for ") + kOtherName));
  EXPECT_THAT(Complaint("./narrow"), HasSubstr("is a program for 32-bit x86"));
}

TEST_F(ProgramTest, AnImagesProgramIsLookedForInTheImageOnly) {
  image_ = PolicyImage{{{"PATH", "/app/bin:/usr/bin"}}, "/app", 1000, 1000};
  Write("image/etc/hosts", "", 0644);
  // The host has it, and the image does not.
  EXPECT_THAT(Complaint("/usr/bin/env"), HasSubstr("which the image does not have"));
  EXPECT_THAT(Complaint("env"), HasSubstr("none of the image's program folders: /app/bin"));
  Write("image/usr/bin/sh", Elf(EM_X86_64, ELFCLASS64, "/lib64/loader"));
  EXPECT_THAT(Complaint("sh"), HasSubstr("\"/lib64/loader\", which the image does not have"));
  Link("image/lib64", "../../usr/lib");
  Write("image/usr/lib/loader", "x");
  Link("image/bin", "usr/bin");
  EXPECT_EQ(Complaint("sh"), "");
  EXPECT_EQ(Complaint("/bin/sh"), "");
  Write("image/app/start", "#!/bin/sh\n");
  EXPECT_EQ(Complaint("./start"), "");
  Write("image/app/windows", "#!/bin/sh\r\n");
  EXPECT_THAT(Complaint("./windows"), HasSubstr("line ends of Windows"));
  Write("image/app/lost", "#!/usr/bin/python9\n");
  EXPECT_THAT(Complaint("./lost"), HasSubstr("/usr/bin/python9"));
  Write("image/tmp/run", "#!/bin/sh\n");
  EXPECT_THAT(Complaint("/tmp/run"), HasSubstr("/tmp are the sandbox's own"));
  Link("image/app/out", folder_ / "image/app/start");
  EXPECT_THAT(Complaint("./out"), HasSubstr("the image does not have"))
      << "a link leads within the image, whatever the host has there";
  Write("image/app/arm", Elf(EM_AARCH64, ELFCLASS64, ""));
  EXPECT_THAT(Complaint("./arm"), HasSubstr("is a program for"));
}

TEST_F(ProgramTest, AnImageWithTooManyNamesAroundARuntimeIsRefused) {
  image_ = PolicyImage{{{"PATH", "/bin"}}, "/", 1000, 1000};
  Write("image/bin/run", "x");
  for (int i = 0; i < 520; ++i) Write(absl::StrCat("image/srv/data/", i), "");
  EXPECT_EQ(Complaint("run"), "") << "one mount shows all of /srv";
  runtimes_ = {"/srv/data/runtime"};
  EXPECT_THAT(Complaint("run"), HasSubstr(
      "more than 512 names along the path to a runtime of policy.json, the last of them in "
      "\"/srv/data\"; leave "
                                          "\"runtimes\""));
}

TEST_F(ProgramTest, AVirtualEnvironmentIsOfAPythonThatTheSandboxHas) {
  const fs::path python = "/usr/bin/python3";
  if (!fs::exists(python)) GTEST_SKIP() << "this host has no /usr/bin/python3";
  const std::string version = fs::canonical(python).filename().string();
  Link("venv/bin/python3", python);
  Link("venv/bin/python", "python3");
  Write("venv/pyvenv.cfg", "home = /usr/bin\nversion = 3\n", 0644);
  EXPECT_THAT(Complaint("venv/bin/python3"), HasSubstr("has no lib/" + version));
  fs::create_directories(folder_ / ("venv/lib/" + version));
  EXPECT_EQ(Complaint("venv/bin/python3"), "");
  EXPECT_EQ(Complaint("./venv/bin/python"), "");
  Write("venv/bin/agent", "#!/policy/venv/bin/python3\n");
  EXPECT_EQ(Complaint("venv/bin/agent"), "");

  Write("venv/pyvenv.cfg", "home = /home/somebody/.pyenv/bin\n", 0644);
  EXPECT_THAT(Complaint("venv/bin/python3"),
              HasSubstr("belongs to the virtual environment \"venv\", whose Python is in "
                        "\"/home/somebody/.pyenv/bin\", which the sandbox does not have"));
  EXPECT_THAT(Complaint("venv/bin/agent"), HasSubstr("/home/somebody/.pyenv/bin"));

  Link("own/bin/python3", "/usr/local/bin/python3.99");
  Write("own/pyvenv.cfg", "home = /usr/local/bin\n", 0644);
  EXPECT_THAT(Complaint("own/bin/python3"), HasSubstr("leads to \"/usr/local/bin/python3.99\""));
}

}  // namespace
}  // namespace myograde::server
