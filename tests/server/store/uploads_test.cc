// Uploads that nobody has submitted, and reruns that have not ended: counted in total and per
// owner, until they are gone.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/base/error_code.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr UnsubmittedLimits kLimits = {
    .count = 4, .bytes = 1000, .of_one = 2, .bytes_of_one = 500, .age = absl::Hours(1)};

class UploadsTest : public StoreTest {
 protected:
  absl::Status Upload(char artefact, const std::string& uploader, int64_t bytes = 10,
                      const std::string& team = "", bool organiser = false) {
    return store_->Write([&](Transaction& writer) -> absl::Status {
      const ArtefactRow row{{"walker", {"./policy"}}, std::string(64, artefact), bytes, 2};
      if (auto added = writer.content.AddArtefact(row); !added.ok()) return added.status();
      return writer.content.AddUpload(row, {uploader, team, organiser}, kLimits);
    });
  }
  std::vector<ArtefactUse> Uploads() {
    std::vector<ArtefactUse> uploads;
    Read([&](const Transaction& reader) { uploads = reader.content.Uploads(); });
    return uploads;
  }
  static void IsOver(const absl::Status& status, const std::string& whose) {
    EXPECT_EQ(ErrorCodeOf(status), "quota") << status;
    EXPECT_THAT(status.message(), HasSubstr(whose));
    EXPECT_THAT(status.message(), HasSubstr("never submitted"));
  }
  absl::StatusOr<bool> Remove(const std::string& kind, char artefact) {
    bool removed = false;
    const absl::Status status = store_->Write([&](Transaction& writer) {
      absl::StatusOr<bool> row = writer.content.Remove(kind, std::string(64, artefact), 10, "old");
      if (row.ok()) removed = *row;
      return row.status();
    });
    if (!status.ok()) return status;
    return removed;
  }
};

TEST_F(UploadsTest, OneUploaderHasSoManyAndSoManyBytes) {
  EXPECT_TRUE(Upload('1', "uid 7").ok());
  EXPECT_TRUE(Upload('2', "uid 7").ok());
  IsOver(Upload('3', "uid 7"), "uid 7 has 2 uploads");
  EXPECT_TRUE(Upload('2', "uid 7").ok()) << "is there already";
  EXPECT_TRUE(Upload('3', "uid 8").ok());
  IsOver(Upload('4', "uid 8", 491), "uid 8 has 1 uploads of 10 bytes");
  EXPECT_TRUE(Upload('4', "uid 8", 490).ok());
  EXPECT_THAT(Uploads(), SizeIs(4));
  Read([](const Transaction& reader) {
    EXPECT_TRUE(absl::IsNotFound(reader.content.Artefact(std::string(64, '5')).status()));
  });
}

TEST_F(UploadsTest, AllTogetherHaveABoundThatOrganisersHaveToo) {
  for (const char artefact : {'1', '2', '3', '4'}) {
    EXPECT_TRUE(Upload(artefact, "uid 0", 10, "", /*organiser=*/true).ok());
  }
  IsOver(Upload('5', "uid 0", 10, "", /*organiser=*/true), "this server has 4 uploads");
  IsOver(Upload('5', "uid 9"), "this server has 4 uploads");
}

TEST_F(UploadsTest, AnOrganisersBytesCountForAll) {
  EXPECT_TRUE(Upload('1', "uid 0", 900, "", /*organiser=*/true).ok());
  IsOver(Upload('2', "uid 9", 101), "this server has 1 uploads of 900 bytes");
  EXPECT_TRUE(Upload('2', "uid 9", 100).ok());
}

TEST_F(UploadsTest, ATeamHasABoundWhoeverUploads) {
  EXPECT_TRUE(Upload('1', "uid 7", 10, "alpha").ok());
  EXPECT_TRUE(Upload('2', "uid 8", 10, "alpha").ok());
  IsOver(Upload('3', "uid 9", 10, "alpha"), "team \"alpha\" has 2 uploads");
  EXPECT_TRUE(Upload('3', "uid 9", 10, "beta").ok());
}

TEST_F(UploadsTest, ASubmissionAndARemovalTakeItAway) {
  EXPECT_TRUE(Upload('1', "uid 7").ok());
  EXPECT_TRUE(Upload('2', "uid 7").ok());
  Submit("alpha", '1');
  EXPECT_THAT(Uploads(), SizeIs(1));
  EXPECT_TRUE(Upload('3', "uid 7").ok());
  EXPECT_FALSE(*Remove(kUploadKind, '1')) << "it was submitted meanwhile";
  EXPECT_TRUE(*Remove(kUploadKind, '2'));
  EXPECT_FALSE(*Remove(kUploadKind, '2'));
  EXPECT_TRUE(*Remove("artefact", '3'));
  EXPECT_THAT(Uploads(), IsEmpty());
  EXPECT_TRUE(Upload('1', "uid 7").ok()) << "files of what was submitted are nobody's";
  EXPECT_THAT(Uploads(), IsEmpty());
  SQLite::Database db(path_);
  EXPECT_EQ(db.execAndGet("SELECT count(*) FROM removal WHERE kind = 'artefact'").getInt(), 2);
}

TEST_F(UploadsTest, TheOldestComesFirstAndANewUploadMakesItYoung) {
  EXPECT_TRUE(Upload('1', "uid 7").ok());
  clock_.Advance(absl::Minutes(1));
  EXPECT_TRUE(Upload('2', "uid 7").ok());
  EXPECT_EQ(Uploads()[0].hash, std::string(64, '1'));
  clock_.Advance(absl::Minutes(1));
  EXPECT_TRUE(Upload('1', "uid 7").ok());
  EXPECT_EQ(Uploads()[0].hash, std::string(64, '2'));
}

class RerunsTest : public StoreTest {
 protected:
  absl::Status Rerun(int64_t submission, const std::string& who, bool organiser = false) {
    return store_->Write([&](Transaction& writer) -> absl::Status {
      constexpr RerunLimits kReruns = {
          .unfinished = 4, .of_one = 2, .of_a_submission = 2, .of_organisers = 5};
      if (auto status = writer.submissions.CheckReruns(submission, who, organiser, kReruns);
          !status.ok()) {
        return status;
      }
      auto added = writer.evaluations.Add(
          {.submission = submission, .kind = EvaluationKind::kRerun, .grader_json = "{}"}, {{0, 1}},
          who);
      if (added.ok()) last_ = *added;
      return added.status();
    });
  }
  Accepted last_;
};

TEST_F(RerunsTest, AreBoundedUntilTheyEnd) {
  const int64_t a = Submit("alpha", 'a').submission;
  const int64_t b = Submit("alpha", 'b').submission;
  const int64_t c = Submit("alpha", 'e').submission;
  EXPECT_TRUE(Rerun(a, "uid 7").ok());
  EXPECT_TRUE(Rerun(a, "uid 8").ok());
  EXPECT_THAT(Rerun(a, "uid 9").message(), HasSubstr("of submission"));
  EXPECT_TRUE(Rerun(b, "uid 7").ok());
  const absl::Status own = Rerun(b, "uid 7");
  EXPECT_THAT(own.message(), HasSubstr("2 reruns that uid 7 asked for"));
  EXPECT_EQ(ErrorCodeOf(own), "quota");
  EXPECT_TRUE(Rerun(b, "uid 8").ok());
  EXPECT_THAT(Rerun(c, "uid 9").message(), HasSubstr("4 reruns have not ended"));
  EXPECT_TRUE(Rerun(a, "uid 0", /*organiser=*/true).ok());
  EXPECT_EQ(ErrorCodeOf(Rerun(a, "uid 0", /*organiser=*/true)), "quota");
  ASSERT_TRUE(store_->Write([&](Transaction& writer) {
    absl::Status status =
        writer.blocks.End(last_.blocks[0], BlockState::kCancelled, false, "uid 0", "enough");
    status.Update(writer.evaluations.End(last_.evaluation, EvaluationState::kCancelled, "enough",
                                         "", "uid 0"));
    return status;
  }).ok());
  EXPECT_TRUE(Rerun(a, "uid 0", /*organiser=*/true).ok());
}

}  // namespace
}  // namespace myograde::server
