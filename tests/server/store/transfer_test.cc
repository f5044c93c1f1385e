// Exports, imports and backups.
#include "server/store/transfer.h"

#include <fstream>

#include <absl/strings/str_cat.h>
#include <gmock/gmock.h>

#include "protocol/base/sha256.h"
#include "server/store/connection.h"
#include "tests/server/store/store_fixture.h"

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

class TransferTest : public StoreTest {
 protected:
  std::string Export(const std::string& store) {
    std::string text;
    ReaderPool pool(store);
    const absl::Status status = pool.Read([&](const Transaction& reader) {
      return reader.Export([&](std::string_view part) {
        text.append(part);
        return true;
      });
    });
    EXPECT_TRUE(status.ok()) << status;
    return text;
  }

  std::string Write(const std::string& text) {
    const std::string path = dir_ + "/export.json";
    std::ofstream(path, std::ios::binary) << text;
    return path;
  }

  // Imports into a new store named `name`.
  absl::Status Import(const std::string& text, const std::string& name) {
    const std::string path = Write(text);
    const absl::StatusOr<ExportInfo> info = CheckExport(path);
    if (!info.ok()) return info.status();
    auto store = Store::Open(dir_ + "/" + name, clock_);
    if (!store.ok()) return store.status();
    return (*store)->Write([&](Transaction& writer) {
      return writer.Import(path, *info, "organiser",
                           [](const Transaction&) { return absl::OkStatus(); });
    });
  }

  // Two submissions, one played to its end, one cancelled, with a ledger and a mark.
  void Fill() {
    const Accepted played = Submit("alpha, \"the first\"", 'a');
    for (const int64_t block : {0, 1}) {
      const int64_t id = played.blocks[static_cast<size_t>(block)];
      ASSERT_TRUE(Start(id, 1).ok());
      ASSERT_TRUE(Record(played, 2 * block, 1, kFacts, R"({"fall_time":null})").ok());
      ASSERT_TRUE(Record(played, 2 * block + 1, 1).ok());
      ASSERT_TRUE(store_->Write([&](Transaction& writer) {
        return writer.blocks.Finish(id, 1, "{}", "daemon");
      }).ok());
    }
    ASSERT_TRUE(store_->Write([&](Transaction& writer) {
      absl::Status status =
          writer.evaluations.End(played.evaluation, EvaluationState::kDone, "", "x", "daemon");
      status.Update(
          writer.journal.Mark(played.submission, "baseline", true, "uid 0", "ours").status());
      status.Update(writer.blocks.RecordAttempt(
          {played.blocks[0], 1, "n1", "7_1", 0, 5, 1.5, std::nullopt, RunEnd::kDone}));
      status.Update(writer.blocks.SetNode("n1", true, "a fan is broken", "uid 0"));
      return status;
    }).ok());
  }
};

TEST_F(TransferTest, AnImportGivesTheSameExportAgain) {
  Fill();
  const std::string text = Export(path_);
  ASSERT_TRUE(Import(text, "copy.db").ok());
  EXPECT_EQ(Export(dir_ + "/copy.db"), text);
  const nlohmann::json json = nlohmann::json::parse(text);
  EXPECT_EQ(json["data"]["episode"].size(), 4u);
  ASSERT_EQ(json["data"]["episode_details"].size(), 2u);
  EXPECT_EQ(json["data"]["episode_details"][0]["details_json"], R"({"fall_time":null})");
  EXPECT_EQ(json["data"]["ledger"].size(), 1u);
  EXPECT_EQ(json["data"]["journal"].back()["private_json"], R"({"why":"ours"})");
  EXPECT_EQ(json["data"]["attempt"][0]["cpu_ms"], 1500);
  EXPECT_EQ(json["data"]["attempt"][0]["energy_mj"], nullptr);
  EXPECT_EQ(json["data"]["node_event"][0]["node"], "n1");
  EXPECT_FALSE(json["data"].contains("meta")) << "the secret stays";
}

TEST_F(TransferTest, WhatHadNotEndedIsCancelled) {
  const Accepted open = Submit("alpha");
  ASSERT_TRUE(Start(open.blocks[0], 1).ok());
  ASSERT_TRUE(Import(Export(path_), "copy.db").ok());
  ReaderPool pool(dir_ + "/copy.db");
  ASSERT_TRUE(pool.Read([&](const Transaction& reader) {
    EXPECT_TRUE(reader.evaluations.Unfinished().rows.empty());
    EXPECT_EQ(reader.evaluations.Find(open.evaluation)->state, EvaluationState::kCancelled);
    return absl::OkStatus();
  }).ok());
}

TEST_F(TransferTest, EveryCutAndEveryChangeOfAByteIsNoticed) {
  Fill();
  const std::string text = Export(path_);
  for (size_t size = 0; size < text.size(); size += 1 + size % 97) {
    EXPECT_FALSE(CheckExport(Write(text.substr(0, size))).ok()) << size;
  }
  for (size_t at = 0; at + 1 < text.size(); at += 1 + at % 61) {
    std::string other = text;
    other[at] = other[at] == '7' ? '8' : '7';
    EXPECT_FALSE(CheckExport(Write(other)).ok()) << text.substr(at, 20);
  }
  EXPECT_FALSE(CheckExport(Write(text + text)).ok());
  EXPECT_TRUE(CheckExport(Write(text)).ok());
}

// As a careful forger would write it, with the checksum fixed.
std::string Sealed(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  const size_t end = text.find(",\"sha256\"");
  return text.substr(0, end) + ",\"sha256\":\"" + Sha256Hex(text.substr(0, end)) + "\"}\n";
}

TEST_F(TransferTest, OtherSchemasFilledStoresAndRowsThatDoNotFitAreRefused) {
  Fill();
  const std::string text = Export(path_);
  const auto refusal = [&](const std::string& changed, const std::string& name) {
    return std::string(Import(changed, name).message());
  };
  const std::string schema = ",\"schema\":" + std::to_string(SchemaMigrations().size());
  EXPECT_THAT(refusal(Sealed(text, schema, ",\"schema\":99"), "a.db"), HasSubstr("schema 99"));
  EXPECT_THAT(refusal(Sealed(text, "\"removal\":[", "\"stain\":["), "b.db"), HasSubstr("stain"));
  EXPECT_THAT(refusal(Sealed(text, "\"ranked\":1", "\"rank\":1"), "c.db"), HasSubstr("columns"));
  EXPECT_THAT(refusal(Sealed(text, "\"ranked\":1", "\"ranked\":2"), "d.db"), HasSubstr("CHECK"));
  EXPECT_THAT(refusal(Sealed(text, "\"evaluation\":1,\"facts", "\"evaluation\":9,\"facts"), "e.db"),
              HasSubstr("block"));
  EXPECT_THAT(refusal(Sealed(text, "\"idx\":1", "\"idx\":0"), "f.db"), HasSubstr("UNIQUE"));
  ASSERT_TRUE(Import(text, "g.db").ok());
  EXPECT_THAT(refusal(text, "g.db"), HasSubstr("has rows already"));
  EXPECT_EQ(Export(dir_ + "/g.db"), text);
}

// Ids that leave none for later rows, that are none, or that no row has.
TEST_F(TransferTest, IdsThatCantBeAreRefusedWithTheirRow) {
  Fill();
  const std::string text = Export(path_);
  int number = 0;
  for (const auto& [from, to, row, why] :
       {std::tuple("\"entry\":\"charge\",\"id\":1", "\"entry\":\"charge\",\"id\":9007199254740993",
                   "row 9007199254740993 of the table ledger", "over 2^53"),
        std::tuple("\"entry\":\"charge\",\"id\":1", "\"entry\":\"charge\",\"id\":\"x\"",
                   "row \"x\" of the table ledger", "mismatch"),
        std::tuple("\"submission\":1,\"team_id\":1", "\"submission\":1,\"team_id\":7",
                   "row 1 of the table ledger", "a row of the table team that is not there"),
        std::tuple("\"block\":1,\"cpu_ms\"", "\"block\":77,\"cpu_ms\"", "row 77/1 of the table attempt",
                   "a row of the table block that is not there")}) {
    const absl::Status refused =
        Import(Sealed(text, from, to), absl::StrCat("ids", ++number, ".db"));
    EXPECT_TRUE(absl::IsInvalidArgument(refused)) << refused;
    EXPECT_THAT(refused.message(), HasSubstr(row));
    EXPECT_THAT(refused.message(), HasSubstr(why));
  }
}

// Files are looked up by these hashes, so none may be a path.
TEST_F(TransferTest, HashesThatAreNoneAreRefused) {
  Fill();
  const std::string text = Export(path_);
  const std::string good = "\"" + std::string(64, 'a') + "\"";
  const std::string digits(64, 'a');
  for (const std::string& bad :
       {"\"" + digits.substr(1) + "\"", "\"" + digits + "a\"", "\"" + digits.substr(1) + "g\"",
        "\"" + std::string(64, 'A') + "\"", "\"" + digits.substr(1) + "/\"",
        std::string("\"../../../etc\""), std::string("\"\""), std::string("7"),
        std::string("null")}) {
    for (const char* column : {"artefact", "hash"}) {
      const std::string key = absl::StrCat("\"", column, "\":");
      const absl::Status status = Import(Sealed(text, key + good, key + bad), "a.db");
      EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
      EXPECT_THAT(status.message(), HasSubstr(absl::StrCat("\"", column, "\" not 64 lower-case")))
          << bad;
    }
  }
  EXPECT_TRUE(Import(text, "a.db").ok()) << "what was refused left nothing";
}

TEST_F(TransferTest, ABackupIsOneStateWhileOthersWrite) {
  Fill();
  // Large enough for more than one step of the copy.
  ASSERT_EQ(SqlError("INSERT INTO meta WITH RECURSIVE n (i) AS (SELECT 1 UNION ALL SELECT i + 1 "
                     "FROM n WHERE i < 20) SELECT 'filling ' || i, randomblob(1000000) FROM n"),
            "");
  const std::string before = Export(path_);
  ReaderPool pool(path_);
  const std::string copy = dir_ + "/backup.db";
  int reports = 0;
  const absl::Status status = pool.Backup(copy, [&](int64_t done, int64_t total) {
    EXPECT_LE(done, total);
    if (++reports == 1) Submit("late", 'e');
  }, [](const std::string& what) { ADD_FAILURE() << what; });
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_GE(reports, 1);
  store_.reset();
  const auto opened = Store::Open(copy, clock_);
  ASSERT_TRUE(opened.ok()) << opened.status();
  const std::string after = Export(copy);
  EXPECT_TRUE(after == before) << "the state when the backup began";
}

}  // namespace
}  // namespace myograde::server
