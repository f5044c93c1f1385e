// Bearer tokens as text.
#include "server/access/identity.h"

#include <set>
#include <string>

#include <gtest/gtest.h>

namespace myograde::server {
namespace {

TEST(TokenTextTest, NewTokensHaveTheFormAndAreAllDifferent) {
  std::set<std::string> seen;
  for (int i = 0; i < 1000; ++i) {
    const absl::StatusOr<std::string> text = NewTokenText();
    ASSERT_TRUE(text.ok()) << text.status();
    EXPECT_EQ(TokenIn("Bearer " + *text), *text);
    EXPECT_TRUE(seen.insert(*text).second);
  }
  // All of the 64 digits are random: each position shows many values.
  for (size_t at = 4; at < 68; ++at) {
    std::set<char> digits;
    for (const std::string& text : seen) digits.insert(text[at]);
    EXPECT_EQ(digits.size(), 16u) << at;
  }
}

TEST(TokenTextTest, OtherTextsAreNone) {
  const std::string digits(64, 'a');
  EXPECT_TRUE(TokenIn("Bearer myo_" + digits).has_value());
  for (const std::string& text :
       {std::string(), digits, std::string("myo_"), "myo_" + digits + "a", "myo_" + digits.substr(1),
        "MYO_" + digits, "myo_" + std::string(64, 'A'), "myo_" + std::string(64, 'g'),
        "\tmyo_" + digits, "myo_" + digits + "\n", "myo_" + digits.substr(1) + '\0'}) {
    EXPECT_FALSE(TokenIn("Bearer " + text).has_value()) << text;
  }
}

TEST(TokenTextTest, TheHashIsTheSha256OfTheText) {
  EXPECT_EQ(TokenHash("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_NE(TokenHash("myo_" + std::string(64, 'a')), TokenHash(std::string(64, 'a')));
}

}  // namespace
}  // namespace myograde::server
