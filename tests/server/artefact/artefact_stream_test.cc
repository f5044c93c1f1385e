// A submission's folder on its way to a node: the same files, modes, times and digest, whatever the
// participant called them; and nothing at all from a tar that is not the daemon's.
#include "server/executor/spool/artefact_tar.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include <gtest/gtest.h>

#include "protocol/base/file.h"
#include "protocol/base/sha256.h"
#include "tests/server/artefact/archives.h"
#include "tests/server/artefact/image_builder.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;

constexpr char kManifest[] = R"({"name": "a", "command": ["./run"]})";

class ArtefactTarTest : public testing::Test {
 protected:
  // Unpacks an upload, as the daemon does.
  Artefact Accept(const std::string& upload) {
    WriteFile(temp_ / "upload", upload).IgnoreError();
    auto artefact = UnpackArtefact(temp_ / "upload", temp_ / "daemon", {});
    EXPECT_TRUE(artefact.ok()) << artefact.status();
    return *artefact;
  }
  Fd NewArchive(const std::string& name = "tar") {
    Fd fd(open((temp_ / name).c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
    EXPECT_TRUE(fd.valid());
    return fd;
  }
  // As one line for each entry: type, mode, time of a file, path, content or target.
  static std::string Describe(const fs::path& folder) {
    std::map<std::string, std::string> lines;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      struct stat info;
      EXPECT_EQ(lstat(entry.path().c_str(), &info), 0);
      std::string line = std::to_string(info.st_mode);
      if (S_ISLNK(info.st_mode)) {
        line = "link " + fs::read_symlink(entry.path()).string();
      } else if (S_ISREG(info.st_mode)) {
        line += " " + std::to_string(info.st_mtime) + " " + *ReadFile(entry.path().string());
      }
      lines[entry.path().lexically_relative(folder).string()] = line;
    }
    std::string all;
    for (const auto& [path, line] : lines) all += path + ": " + line + "\n";
    return all;
  }
  void ExpectRoundTrip(const std::string& digest) {
    const Fd archive = NewArchive();
    const auto packed = PackArtefactFolder(temp_ / "daemon", digest, archive.get());
    ASSERT_TRUE(packed.ok()) << packed.status();
    EXPECT_EQ(*Sha256File(temp_ / "tar"), packed->sha256);
    EXPECT_EQ(static_cast<int64_t>(fs::file_size(temp_ / "tar")), packed->bytes);
    ASSERT_EQ(UnpackArtefactFolder(archive.get(), *packed, digest, temp_ / "node"),
              absl::OkStatus());
    EXPECT_EQ(Describe(temp_ / "node"), Describe(temp_ / "daemon"));

    const Fd again = NewArchive("again");
    EXPECT_EQ(PackArtefactFolder(temp_ / "node", digest, again.get())->sha256, packed->sha256);
  }
  // What happens with a tar of these bytes, that the order describes truly.
  absl::Status Unpack(const std::string& bytes, const std::string& digest) {
    WriteFile(temp_ / "tar", bytes).IgnoreError();
    const Fd archive(open((temp_ / "tar").c_str(), O_RDONLY | O_CLOEXEC));
    const PackedFolder packed = {Sha256Hex(bytes), static_cast<int64_t>(bytes.size())};
    return UnpackArtefactFolder(archive.get(), packed, digest, temp_ / "node");
  }

  const TestFolder temp_;
};

TEST_F(ArtefactTarTest, ASubmissionArrivesAsItLeft) {
  const std::string long_name(200, 'n');
  const Artefact artefact = Accept(
      TarEntry('0', "policy.json", kManifest) + TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) +
      TarEntry('5', "empty/") + TarEntry('0', "-rf", "a dash") +
      TarEntry('0', "deep/er/caf\xc3\xa9 \"quoted\" %s", "text") + TarEntry('0', "zeros", "") +
      TarEntry('2', "python", {}, "/usr/bin/python3") +
      PaxHeader("path", "deep/" + long_name) + TarEntry('0', "x", "long") +
      TarEntry('0', "large", std::string(700'001, 'L')) + std::string(1024, '\0'));
  ExpectRoundTrip(artefact.digest);
}

TEST_F(ArtefactTarTest, AnImageArrivesAsItLeft) {
  const Artefact artefact = Accept(DockerImage(
      {Layer(TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + TarEntry('5', "usr/lib/") +
             TarEntry('2', "lib", {}, "usr/lib") + TarEntry('2', "usr/up", {}, "../../../etc") +
             TarEntry('0', "etc/passwd", "root:x:0:0::/:/bin/sh\n"))}));
  EXPECT_TRUE(fs::is_symlink(temp_ / "daemon/image/usr/up"));
  ExpectRoundTrip(artefact.digest);
}

TEST_F(ArtefactTarTest, AFolderThatIsNotTheArtefactIsNotPacked) {
  const Artefact artefact =
      Accept(TarEntry('0', "policy.json", kManifest) +
             TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'));
  const Fd archive = NewArchive();
  ASSERT_TRUE(WriteFile(temp_ / "daemon/run", "#!/bin/sx\n").ok());
  EXPECT_TRUE(absl::IsDataLoss(
      PackArtefactFolder(temp_ / "daemon", artefact.digest, archive.get()).status()));
  ASSERT_EQ(mkfifo((temp_ / "daemon/pipe").c_str(), 0644), 0);
  EXPECT_TRUE(absl::IsDataLoss(
      PackArtefactFolder(temp_ / "daemon", artefact.digest, archive.get()).status()));
  EXPECT_FALSE(PackArtefactFolder(temp_ / "none", artefact.digest, archive.get()).ok());
}

TEST_F(ArtefactTarTest, OnlyTheOrderedArchiveIsUnpacked) {
  const Artefact artefact =
      Accept(TarEntry('0', "policy.json", kManifest) +
             TarEntry('0', "run", "#!/bin/sh\n", {}, 0755) + std::string(1024, '\0'));
  const Fd archive = NewArchive();
  auto packed = PackArtefactFolder(temp_ / "daemon", artefact.digest, archive.get());
  ASSERT_TRUE(packed.ok()) << packed.status();
  PackedFolder other = *packed;
  other.sha256[0] = other.sha256[0] == 'a' ? 'b' : 'a';
  EXPECT_TRUE(absl::IsDataLoss(
      UnpackArtefactFolder(archive.get(), other, artefact.digest, temp_ / "node")));
  EXPECT_TRUE(absl::IsDataLoss(
      UnpackArtefactFolder(archive.get(), *packed, std::string(64, '0'), temp_ / "node")));
  EXPECT_FALSE(fs::exists(temp_ / "node"));
  ASSERT_EQ(ftruncate(archive.get(), packed->bytes / 2), 0);
  EXPECT_TRUE(absl::IsDataLoss(
      UnpackArtefactFolder(archive.get(), *packed, artefact.digest, temp_ / "node")));
  EXPECT_FALSE(fs::exists(temp_ / "node"));
}

TEST_F(ArtefactTarTest, NothingIsMadeOutsideTheFolder) {
  ASSERT_TRUE(fs::create_directory(temp_ / "outside"));
  const std::string end(1024, '\0');
  const std::string outside = temp_ / "outside";
  for (const std::string& bytes :
       {TarEntry('0', "../outside/x", "x") + end, TarEntry('0', outside + "/x", "x") + end,
        TarEntry('2', "a", {}, outside) + TarEntry('0', "a/x", "x") + end,
        TarEntry('2', "a", {}, "..") + TarEntry('0', "a/outside/x", "x") + end,
        TarEntry('5', "b/") + TarEntry('1', "b/x", {}, "../outside/x") + end,
        TarEntry('6', "pipe") + end, TarEntry('0', "twice", "1") + TarEntry('0', "twice", "2") + end,
        std::string("no tar"), std::string()}) {
    EXPECT_FALSE(Unpack(bytes, std::string(64, '0')).ok());
    EXPECT_TRUE(fs::is_empty(temp_ / "outside"));
    EXPECT_FALSE(fs::exists(temp_ / "node"));
  }
}

}  // namespace
}  // namespace myograde::server
