// What a node writes is taken as far as it is sound: lines as they become complete, a log before its
// record, the last record after the node's last word.
#include "server/executor/slurm/lease_reader.h"

#include <gmock/gmock.h>
#include <fcntl.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include <absl/strings/str_cat.h>

#include "tests/server/artefact/archives.h"

namespace myograde::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr char kName[] = "12-1-0123456789abcdef";
constexpr absl::Duration kNow = absl::Seconds(500);
const absl::Duration kLater = kNow + LeaseReader::kPatience;

class SlurmReader : public ::testing::Test {
 protected:
  SlurmReader()
      : spool_(*Spool::Make(folder_ / "spool")),
        lease_(*spool_.MakeLease(kName)),
        reader_(kName, folder_ / "logs") {
    fs::create_directory(folder_ / "logs");
  }
  void Claim() {
    EXPECT_TRUE(lease_.PutClaim({"n1", "7_1", 0, std::string(16, 'a')}).ok());
    EXPECT_EQ(Look().claim->node, "n1");
    reader_.Trust();
  }
  LeaseNews Look(absl::Duration now = kNow) { return reader_.Look(spool_, now); }
  void Write(const std::string& text) {
    EXPECT_TRUE(lease_.WriteRecords(std::ssize(text_), text).ok());
    text_ += text;
  }
  void End(const std::string& why = "") {
    NodeEnd end;
    end.records_bytes = std::ssize(text_);
    end.records_sha256 = Sha256Hex(text_);
    end.why = why;
    EXPECT_TRUE(lease_.PutEnd(end).ok());
  }
  static std::string Progress(int64_t step) {
    return LeaseRecordToLine(ProgressRecord{0, step}) + "\n";
  }
  static std::string Last() {
    LeaseEndRecord end;
    end.ok = true;
    return LeaseRecordToLine(end) + "\n";
  }
  static std::string Episode(const std::string& sha256) {
    EpisodeFacts facts;
    facts.end = EpisodeEnd::kTime;
    facts.digest = std::string(64, 'd');
    facts.track = ElbowFacts();
    facts.log = {.sha256 = sha256, .bytes = 100, .packed_bytes = 4, .steps = 1};
    return LeaseRecordToLine(facts) + "\n";
  }

  TestFolder folder_;
  Spool spool_;
  LeaseFolder lease_;
  LeaseReader reader_;
  std::string text_;
};

TEST_F(SlurmReader, TakesLinesAsTheyBecomeComplete) {
  EXPECT_TRUE(Look().looked);
  Claim();
  const std::string line = Progress(1);
  Write(line.substr(0, 10));
  EXPECT_THAT(Look().records, IsEmpty());
  Write(line.substr(10) + Progress(2) + "{\"ty");
  EXPECT_THAT(Look().records, SizeIs(2));
  EXPECT_THAT(Look().records, IsEmpty());
}

TEST_F(SlurmReader, TheLastRecordComesWithTheNodesLastWord) {
  Claim();
  Write(Progress(1) + Last());
  EXPECT_THAT(Look().records, SizeIs(1));
  End();
  const LeaseNews news = Look();
  EXPECT_THAT(news.records, SizeIs(1));
  EXPECT_TRUE(news.end.has_value());
  EXPECT_FALSE(Look().end.has_value()) << "once";
}

TEST_F(SlurmReader, RecordsOfANodeThatIsNotTrustedAreNotRead) {
  EXPECT_TRUE(lease_.PutClaim({"n1", "7_1", 0, std::string(16, 'a')}).ok());
  Write(Progress(1));
  End("its build is another");
  const LeaseNews news = Look();
  EXPECT_THAT(news.records, IsEmpty());
  EXPECT_EQ(news.end->why, "its build is another");
}

TEST_F(SlurmReader, RecordsThatTheNodeDidNotWriteAreFound) {
  Claim();
  Write(Progress(1));
  End();
  // Altered after it was sent: as long, but another.
  EXPECT_TRUE(lease_.WriteRecords(0, Progress(2)).ok());
  EXPECT_THAT(Look().broken, HasSubstr("not those that its node wrote"));
}

TEST_F(SlurmReader, RecordsThatAreMissingAreWaitedForButNotForEver) {
  Claim();
  Write(Progress(1));
  text_ += Last();
  End();
  EXPECT_EQ(Look().broken, "");
  EXPECT_THAT(Look(kLater).broken, HasSubstr("only"));
}

TEST_F(SlurmReader, ZerosOfASharedDiskAreWaitedOut) {
  Claim();
  const std::string line = Progress(1);
  EXPECT_TRUE(lease_.WriteRecords(0, std::string(line.size(), '\0')).ok());
  EXPECT_EQ(Look().broken, "");
  Write(line);
  EXPECT_THAT(Look().records, SizeIs(1));
  Write(std::string(8, '\0'));
  EXPECT_EQ(Look().broken, "");
  EXPECT_THAT(Look(kLater).broken, HasSubstr("zeros"));
  EXPECT_THAT(Look(kLater).broken, IsEmpty()) << "nothing follows";
}

TEST_F(SlurmReader, WhatIsNoRecordBreaksTheLease) {
  Claim();
  Write("{\"type\": \"progress\"}\n");
  EXPECT_THAT(Look().broken, HasSubstr("what is no record"));
}

TEST_F(SlurmReader, NothingFollowsTheLastRecord) {
  Claim();
  Write(Last() + Progress(1));
  EXPECT_THAT(Look().broken, HasSubstr("after its last one"));
}

TEST_F(SlurmReader, ALogThatIsNotThereYetHoldsItsRecordBack) {
  Claim();
  const std::string sha256(64, 'a');
  Write(Progress(1) + Episode(sha256));
  EXPECT_THAT(Look().records, SizeIs(1));
  EXPECT_EQ(Look().broken, "");
  EXPECT_THAT(Look(kLater).broken, HasSubstr("logs"));
}

TEST_F(SlurmReader, ALogWithOtherContentIsRefused) {
  Claim();
  const std::string sha256(64, 'a');
  std::ofstream(folder_ / "file") << "junk";
  const Fd file(open((folder_ / "file").c_str(), O_RDONLY | O_CLOEXEC));
  EXPECT_TRUE(lease_.PutLog(sha256 + ".lcmlog.zst", BytesOf(file.get()), 1000).ok());
  Write(Episode(sha256));
  EXPECT_THAT(Look().broken, HasSubstr("is not the one that its record names"));
  EXPECT_TRUE(fs::is_empty(folder_ / "logs"));
}

TEST_F(SlurmReader, ASpoolThatCannotBeReadSaysNothing) {
  Claim();
  fs::rename(folder_ / (std::string("spool/leases/") + kName), folder_ / "spool/away");
  EXPECT_FALSE(Look().looked);
  EXPECT_EQ(Look(kLater).broken, "");
}

}  // namespace
}  // namespace myograde::server
