// Which files can be packed, and what is said of the others.
#include <archive_entry.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "server/artefact/artefact.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(PackArtefact, TellsMistakesBeforeAnythingIsSent) {
  const TestFolder temp;
  const auto complaint = [&](const std::string& path) {
    return std::string(PackArtefact(path, temp / "a", {}).status().message());
  };
  MakeFile(temp / "data.txt", "hello", 0644);
  MakeFile(temp / "program", "#!/bin/sh\n", 0644);
  MakeFile(temp / "empty", "", 0755);
  MakeFile(temp / "fake.tar.gz", "hello", 0644);
  EXPECT_THAT(complaint(temp / "missing"), HasSubstr("No such file"));
  EXPECT_THAT(complaint(temp / "program"), HasSubstr("is not executable; set its bit"));
  EXPECT_THAT(complaint(temp / "empty"), HasSubstr("empty file"));
  EXPECT_THAT(complaint(temp / "fake.tar.gz"), HasSubstr("archive"));
  EXPECT_THAT(complaint("/dev/null"), HasSubstr("neither a file nor a folder"));
  fs::create_directory(temp / "p");
  EXPECT_THAT(complaint(temp / "p"), HasSubstr("no policy.json"));
  MakeFile(temp / "p/policy.json", kManifest, 0644);
  MakeFile(temp / "p/policy", "#!/bin/sh\n", 0755);
  ASSERT_EQ(complaint(temp / "p"), "");
  ASSERT_EQ(::mkfifo((temp / "p/pipe").c_str(), 0600), 0);
  EXPECT_THAT(complaint(temp / "p"), HasSubstr("\"pipe\" is not a file"));
  fs::remove(temp / "p/pipe");
  fs::create_symlink("../data.txt", temp / "p/out");
  EXPECT_THAT(complaint(temp / "p"), HasSubstr("targets with \"..\""));
}

TEST(PackArtefact, AFileIsWhatItsFirstBytesSayWhateverItsNameAndMode) {
  const TestFolder temp;
  int number = 0;
  for (const Kind kind : {Kind::kTar, Kind::kTarGz, Kind::kTarZst, Kind::kTarXz, Kind::kTarBz2, Kind::kZip}) {
    for (const char* name : {"walker", "walker.oci", "WALKER.TAR.GZ"}) {
      const std::string path = temp / (std::to_string(number++) + name);
      WriteArchive(path, {{.path = "policy.json", .content = kManifest},
                          {.path = "policy", .content = "#!/bin/sh\n", .mode = AE_IFREG | 0755}}, kind);
      fs::permissions(path, fs::perms(number % 2 == 0 ? 0644 : 0755));
      const auto packed = PackArtefact(path, temp / "a", {});
      ASSERT_TRUE(packed.ok()) << path << ": " << packed.status();
      EXPECT_EQ(packed->name, "walker");
    }
  }
  const auto complaint = [&](const std::string& path) {
    return std::string(PackArtefact(path, temp / "a", {}).status().message());
  };
  for (const mode_t mode : {0644, 0755}) {
    MakeFile(temp / "a.7z", "7z\xbc\xaf\x27\x1c", mode);
    MakeFile(temp / "a.rar", "Rar!\x1a\x07", mode);
    MakeFile(temp / "a.tar.lz4", "\x04\x22\x4d\x18xxx", mode);
    MakeFile(temp / "policy.py", "import myograde\n", mode);
    MakeFile(temp / "data.txt", "hello", mode);
    for (const auto& [file, why] :
         {std::pair("a.7z", "packed by 7z"), {"a.rar", "packed by RAR"}, {"a.tar.lz4", "packed by LZ4"},
          {"policy.py", "\"command\": [\"python3\""}, {"data.txt", "is not a program"}}) {
      EXPECT_THAT(complaint(temp / file), HasSubstr(why));
      EXPECT_THAT(complaint(temp / file), Not(HasSubstr("chmod")));
    }
  }
}

}  // namespace
}  // namespace myograde::server
