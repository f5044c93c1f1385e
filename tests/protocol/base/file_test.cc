#include "protocol/base/file.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_join.h>
#include <gtest/gtest.h>

#include "protocol/base/fd.h"

namespace myograde {
namespace {

class FileTest : public testing::Test {
 protected:
  FileTest() {
    char name[] = "/tmp/myograde-file-XXXXXX";
    Fd(mkstemp(name));
    path_ = name;
  }
  ~FileTest() override { unlink(path_.c_str()); }

  std::string path_;
};

TEST_F(FileTest, WhatIsWrittenIsRead) {
  for (const size_t size : {0, 1, 16383, 16384, 16385, 1000000}) {
    std::string text(size, 'a');
    if (size > 0) text.back() = '\0';
    ASSERT_TRUE(WriteFile(path_, text).ok());
    EXPECT_EQ(ReadFile(path_).value(), text) << size;
  }
}

TEST_F(FileTest, ALimitIsTheLargestSizeThatIsRead) {
  ASSERT_TRUE(WriteFile(path_, "12345").ok());
  EXPECT_TRUE(ReadFile(path_, 5).ok());
  const absl::Status status = ReadFile(path_, 4).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message(), absl::StrCat(path_, ": is larger than 4 bytes"));
}

TEST_F(FileTest, LinesAreReadOneByOneWhereverTheirPiecesEnd) {
  const auto lines_of = [&](const std::string& text, size_t max_line,
                            std::vector<std::string>& lines) {
    EXPECT_TRUE(WriteFile(path_, text).ok());
    return ForEachLine(OpenToRead(path_)->get(), path_, max_line,
                       [&](std::string_view line, int64_t number) {
                         lines.emplace_back(line);
                         EXPECT_EQ(std::ssize(lines), number);
                         return line == "stop" ? absl::CancelledError("stopped")
                                               : absl::OkStatus();
                       });
  };
  for (const size_t size : {1, 16382, 16383, 16384, 16385, 50000}) {
    const std::string line(size, 'a');
    const std::vector<std::string> expected = {line, "", std::string("\0\r", 2), line};
    const std::string text = absl::StrJoin(expected, "\n");
    std::vector<std::string> lines;
    EXPECT_TRUE(lines_of(text + "\n", size + 1, lines).ok()) << size;
    EXPECT_EQ(lines, expected) << size;
    lines.clear();
    EXPECT_EQ(lines_of("b\n" + line + "\n", size - 1, lines).message(),
              absl::StrCat(path_, size == 1 ? ": line 1" : ": line 2",
                           ": is too long; the file was changed or cut off: export it again"));
    lines.clear();
    const absl::Status cut = lines_of(text, size + 1, lines);
    EXPECT_EQ(cut.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(cut.message(),
              absl::StrCat(path_, ": line 4: ends in the middle; the file was changed or cut off: export it again"));
    EXPECT_EQ(lines.size(), 3u) << size;
  }
  std::vector<std::string> lines;
  EXPECT_TRUE(lines_of("", 1, lines).ok());
  EXPECT_TRUE(lines.empty());
  EXPECT_EQ(lines_of("a\nstop\nb\n", 4, lines).message(), "stopped");
  EXPECT_EQ(lines, (std::vector<std::string>{"a", "stop"}));
  const Fd folder(open("/tmp", O_RDONLY | O_CLOEXEC));
  EXPECT_EQ(ForEachLine(folder.get(), "it", 1, nullptr).message(),
            "it: can't be read: Is a directory");
}

TEST_F(FileTest, WhatCannotBeReadIsNamedWithTheReason) {
  EXPECT_EQ(ReadFile(path_ + ".none").status().message(),
            absl::StrCat(path_, ".none: can't be read: No such file or directory"));
  EXPECT_EQ(ReadFile("/tmp").status().message(), "/tmp: is a folder; it must be a file");
  EXPECT_EQ(WriteFile("/tmp", "a").message(), "/tmp: can't be written: Is a directory");
}

TEST_F(FileTest, AFullDiskIsToldAtTheEnd) {
  EXPECT_EQ(WriteFile("/dev/full", "a").message(),
            "/dev/full: can't be written: No space left on device");
}

TEST_F(FileTest, AFileOfAProcessThatHasEndedIsAnErrorAndNothingWorse) {
  const pid_t child = fork();
  if (child == 0) _exit(0);
  const Fd status(open(absl::StrCat("/proc/", child, "/status").c_str(), O_RDONLY | O_CLOEXEC));
  ASSERT_TRUE(status.valid());
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  EXPECT_EQ(ReadAll(status.get(), "status").status().message(),
            "status: can't be read: No such process");
}

}  // namespace
}  // namespace myograde
