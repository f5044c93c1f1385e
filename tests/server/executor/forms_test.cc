// What the daemon and its nodes write for each other: written, read again, and refused.
#include "server/executor/spool/forms.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/server/executor/node_order.h"

namespace myograde::server {
namespace {

using nlohmann::json;
using testing::HasSubstr;

// `text` with a merge patch.
std::string Patched(const std::string& text, const json& patch) {
  json form = json::parse(text);
  form.merge_patch(patch);
  return form.dump();
}

NodeClaim SomeClaim() { return {"n1", "1234_5", 2, "0123456789abcdef"}; }

NodeProof SomeProof() {
  return {"n1", "Xeon", "6.1", "0.1.0", R"({"version":"0.1.0"})", "", {"no user namespaces"}};
}

NodeEnd SomeEnd() { return {256, "killed\n", 12, std::string(64, 'd'), 1.5, 20.25, "preempted"}; }

TEST(Forms, AnOrderIsReadAsItWasWritten) {
  NodeOrder order = SomeNodeOrder();
  const std::string text = NodeOrderToText(order);
  EXPECT_EQ(text.find('\n'), std::string::npos);
  auto read = NodeOrderFromText(text, "order");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(NodeOrderToText(*read), text);
  EXPECT_EQ(read->name, order.name);
  EXPECT_EQ(read->grader, order.grader);
  EXPECT_EQ(read->artefact->archive_bytes, 10240);
  EXPECT_EQ(read->runtimes[0].path, "/opt/torch");
  EXPECT_EQ(read->prove_again, order.prove_again);
  EXPECT_EQ(read->order.episodes[1].policy_seed, 10u);

  order.artefact.reset();
  read = NodeOrderFromText(NodeOrderToText(order), "order");
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_FALSE(read->artefact.has_value());
}

TEST(Forms, WhatNodesWriteIsReadAsItWasWritten) {
  const auto claim = NodeClaimFromText(NodeClaimToText(SomeClaim()), "claim");
  ASSERT_TRUE(claim.ok()) << claim.status();
  EXPECT_EQ(NodeClaimToText(*claim), NodeClaimToText(SomeClaim()));
  const auto proof = NodeProofFromText(NodeProofToText(SomeProof()), "proof");
  ASSERT_TRUE(proof.ok()) << proof.status();
  EXPECT_EQ(NodeProofToText(*proof), NodeProofToText(SomeProof()));
  auto end = NodeEndFromText(NodeEndToText(SomeEnd()), "end");
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_EQ(NodeEndToText(*end), NodeEndToText(SomeEnd()));
  EXPECT_EQ(end->energy_j, 20.25);

  NodeEnd unmeasured = SomeEnd();
  unmeasured.energy_j.reset();
  end = NodeEndFromText(NodeEndToText(unmeasured), "end");
  ASSERT_TRUE(end.ok()) << end.status();
  EXPECT_FALSE(end->energy_j.has_value());
}

TEST(Forms, MistakesInAnOrderAreNamed) {
  const std::string text = NodeOrderToText(SomeNodeOrder());
  const std::pair<json, const char*> mistakes[] = {
      {{{"form", 2}}, "\"form\""},
      {{{"name", "../../etc"}}, "\"name\""},
      {{{"epoch", ""}}, "\"epoch\""},
      {{{"epoch", "two\nlines"}}, "\"epoch\""},
      {{{"grader", "text"}}, "\"grader\""},
      {{{"wall_s", -1}}, "\"wall_s\""},
      {{{"unknown", 1}}, "unknown"},
      {{{"artefact", nullptr}}, "\"artefact\" is missing"},  // a merge patch removes it
      {{{"artefact", {{"digest", "AA"}}}}, "\"digest\""},
      {{{"artefact", {{"archive_bytes", 0}}}}, "\"archive_bytes\""},
      {{{"artefact", 5}}, "artefact"},
      {{{"runtimes", json::array({{{"name", "a"}, {"digest", ""}, {"path", "b"}}})}}, "\"path\""},
      {{{"order", {{"command", json::array()}}}}, "\"command\""},
      {{{"prove_again", 1}}, "\"prove_again\""}};
  for (const auto& [patch, named] : mistakes) {
    const auto read = NodeOrderFromText(Patched(text, patch), "order");
    EXPECT_TRUE(absl::IsInvalidArgument(read.status())) << patch;
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(named)) << patch;
  }
}

TEST(Forms, MistakesOfNodesAreNamed) {
  const std::pair<json, const char*> in_claims[] = {
      {{{"node", "a/b"}}, "\"node\""},        {{{"node", ".."}}, "\"node\""},
      {{{"job", "1\u202e2"}}, "\"job\""},     {{{"restart", -1}}, "\"restart\""},
      {{{"nonce", "0123456789ABCDEF"}}, "\"nonce\""}};
  for (const auto& [patch, named] : in_claims) {
    const auto read = NodeClaimFromText(Patched(NodeClaimToText(SomeClaim()), patch), "claim");
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(named)) << patch;
  }
  const std::pair<json, const char*> in_proofs[] = {
      {{{"processor", std::string(300, 'x')}}, "\"processor\""},
      {{{"grader", 1}}, "\"grader\""},
      {{{"reference", std::string(17000, 'x')}}, "\"reference\""},
      {{{"doctor", json::array({1})}}, "\"doctor\""},
      {{{"doctor", json(std::vector<std::string>(65, "x"))}}, "\"doctor\""}};
  for (const auto& [patch, named] : in_proofs) {
    const auto read = NodeProofFromText(Patched(NodeProofToText(SomeProof()), patch), "proof");
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(named)) << patch;
  }
  const std::pair<json, const char*> in_ends[] = {
      {{{"wait_status", 70000}}, "\"wait_status\""},
      {{{"records_bytes", kMostRecordBytes + 1}}, "\"records_bytes\""},
      {{{"records_sha256", ""}}, "\"records_sha256\""},
      {{{"cpu_s", -1}}, "\"cpu_s\""},
      {{{"energy_j", "much"}}, "\"energy_j\""}};
  for (const auto& [patch, named] : in_ends) {
    const auto read = NodeEndFromText(Patched(NodeEndToText(SomeEnd()), patch), "end");
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(named)) << patch;
  }
}

TEST(Forms, TextsOfAnotherKindAreRefused) {
  for (const std::string text : {"", "[]", "null", "{", "{\"form\":1}", "\xff"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(NodeOrderFromText(text, "x").status())) << text;
    EXPECT_TRUE(absl::IsInvalidArgument(NodeClaimFromText(text, "x").status())) << text;
    EXPECT_TRUE(absl::IsInvalidArgument(NodeProofFromText(text, "x").status())) << text;
    EXPECT_TRUE(absl::IsInvalidArgument(NodeEndFromText(text, "x").status())) << text;
  }
  const std::string long_text(kMostFormBytes + 1, ' ');
  EXPECT_TRUE(absl::IsInvalidArgument(NodeClaimFromText(long_text, "x").status()));
}

TEST(Forms, NamesOfFoldersNodesAndLogsAreStrict) {
  EXPECT_TRUE(IsLeaseName("12-1-0123456789abcdef"));
  for (const char* name : {"", "12-1", "12-1-0123456789abcde", "12-1-0123456789abcdeF",
                           "a-1-0123456789abcdef", "12--0123456789abcdef", "..", "12-1-/123456789abcdef",
                           "12345678901234567890-1-0123456789abcdef"}) {
    EXPECT_FALSE(IsLeaseName(name)) << name;
  }
  EXPECT_TRUE(IsNodeName("node-17.rack_3"));
  for (const char* name : {"", ".", "..", "a b", "a/b", "caf\u00e9"}) {
    EXPECT_FALSE(IsNodeName(name)) << name;
  }
  EXPECT_TRUE(IsLogName(std::string(64, '0') + ".lcmlog.zst"));
  EXPECT_FALSE(IsLogName(std::string(64, '0')));
  EXPECT_FALSE(IsLogName("../" + std::string(64, '0') + ".lcmlog.zst"));
}

}  // namespace
}  // namespace myograde::server
