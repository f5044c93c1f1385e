#include "protocol/base/file.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>

#include <absl/strings/str_cat.h>
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
