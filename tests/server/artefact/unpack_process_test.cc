// Unpacking in a process of its own: the same answers, and an end to archives
// that are slow or hungry.
#include "server/artefact/unpack_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <string>

#include "protocol/base/clock.h"
#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr UnpackBudget kBudget = {.time = absl::Seconds(60), .memory_bytes = 256 << 20};

std::string Honest() {
  return TarEntry('0', "policy.json", R"({"name": "ü", "command": ["./policy", "a b"]})") +
         TarEntry('0', "policy", "#!/bin/sh\n", {}, 0755);
}

TEST(UnpackProcess, AnswersAsUnpackArtefactDoes) {
  const TempFolder temp;
  WritePacked(temp / "a", Honest() + std::string(1024, '\0'), Kind::kTarGz);
  const auto apart = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  ASSERT_TRUE(apart.ok()) << apart.status();
  const auto here = UnpackArtefact(temp / "a", temp / "out2", {});
  ASSERT_TRUE(here.ok()) << here.status();
  EXPECT_EQ(apart->digest, here->digest);
  EXPECT_EQ(apart->manifest.name, here->manifest.name);
  EXPECT_EQ(apart->manifest.command, here->manifest.command);
  EXPECT_EQ(apart->bytes, here->bytes);
  EXPECT_EQ(apart->files, here->files);
  EXPECT_TRUE(fs::exists(temp / "out/policy"));
}

TEST(UnpackProcess, RefusalsArriveWithTheirSentence) {
  const TempFolder temp;
  WritePacked(temp / "a", Honest() + TarEntry('0', "../evil", "x"), Kind::kTarGz);
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status()));
  EXPECT_THAT(artefact.status().message(), HasSubstr("\"..\" in its path"));
  EXPECT_FALSE(fs::exists(temp / "out"));
  const auto small = UnpackInProcess(temp / "a", temp / "out", {.files = 1}, kBudget);
  EXPECT_THAT(small.status().message(), HasSubstr("more than 1 files"));
  const auto missing = UnpackInProcess(temp / "missing", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsUnavailable(missing.status())) << missing.status();
}

TEST(UnpackProcess, EndsAtItsDeadline) {
  const TempFolder temp;
  // A pipe that nobody writes to: as slow as an archive can be.
  ASSERT_EQ(::mkfifo((temp / "a").c_str(), 0600), 0);
  const absl::Duration start = SystemClock().Monotonic();
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {},
                                        {.time = absl::Seconds(1), .memory_bytes = 256 << 20});
  EXPECT_LT(SystemClock().Monotonic() - start, absl::Seconds(20));
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
  EXPECT_THAT(artefact.status().message(), HasSubstr("could not be unpacked in the 1 s"));
  EXPECT_FALSE(fs::exists(temp / "out"));
}

TEST(UnpackProcess, MemoryIsLimited) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "a sanitizer's shadow takes more addresses than any limit of memory";
#endif
  // The map of a sparse file: 48 bytes of memory for each 4 bytes that pack to nothing.
  std::string map = "20000000\n";
  for (int i = 0; i < 20'000'000; ++i) map += "0\n0\n";
  std::string tar = Honest() + PaxHeader("GNU.sparse.major", "1") +
                    PaxHeader("GNU.sparse.minor", "0") + PaxHeader("GNU.sparse.realsize", "1000") +
                    TarHeader('0', "holes", "", 0644, map.size());
  tar += map + TarPadding(map.size());
  const TempFolder temp;
  WritePacked(temp / "a", tar, Kind::kTarZst);
  ASSERT_LT(fs::file_size(temp / "a"), 1u << 20);
  const auto artefact = UnpackInProcess(temp / "a", temp / "out", {}, kBudget);
  EXPECT_TRUE(absl::IsInvalidArgument(artefact.status())) << artefact.status();
  EXPECT_FALSE(fs::exists(temp / "out"));
}

TEST(UnpackProcess, BudgetsMustBeAboveZero) {
  const TempFolder temp;
  for (const UnpackBudget& budget : {UnpackBudget{absl::ZeroDuration(), 1 << 30},
                                     UnpackBudget{absl::Seconds(1), 0},
                                     UnpackBudget{absl::Seconds(-1), -1}}) {
    EXPECT_TRUE(absl::IsFailedPrecondition(
        UnpackInProcess(temp / "a", temp / "out", {}, budget).status()));
  }
}

}  // namespace
}  // namespace myograde::server

int main(int argc, char** argv) {
  if (int status = 0; myograde::server::RunUnpackProcess(argc, argv, status)) return status;
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
