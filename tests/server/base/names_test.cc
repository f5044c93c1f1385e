// Names on boards: invisible characters are rejected, and look-alikes detected.
#include "server/base/names.h"

#include <unicode/locid.h>
#include <unicode/normalizer2.h>
#include <unicode/unistr.h>

#include <algorithm>
#include <iterator>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

namespace myograde::server {
namespace {

using ::testing::HasSubstr;

std::string Utf8(const std::u16string& text) {
  std::string utf8;
  icu::UnicodeString(text.data(), static_cast<int32_t>(text.size())).toUTF8String(utf8);
  return utf8;
}

// Whether two names may be mistaken for each other.
bool AreAlike(const std::string& a, const std::string& b) {
  const std::set<std::string> looks = ConfusableSkeletons(a);
  const std::set<std::string> others = ConfusableSkeletons(b);
  return std::any_of(looks.begin(), looks.end(),
                     [&](const std::string& look) { return others.contains(look); });
}

// What happens to a name when a given team exists.
enum class Fate { kSame, kRefused, kAlike, kOther };
Fate FateBeside(const std::string& team, const std::string& name) {
  const absl::StatusOr<std::string> clean = CleanName(name, "name");
  if (!clean.ok()) return Fate::kRefused;
  if (*clean == team) return Fate::kSame;
  return AreAlike(*clean, team) ? Fate::kAlike : Fate::kOther;
}

TEST(CleanName, TakesWhatTeamsAreCalled) {
  for (const char* name :
       {"a", "Team Blue", "Läufer 2", "Équipe Numéro 7", "チーム青", "蓝队", "Команда", "صقور", "ทีมสีฟ้า",
        "नीला दल", "दिल्ली",
        "ខ្មែរ", "ស្ត្រី", "မန္တလေး", "အင်္ဂလိပ်", "ᩅ᩠ᨿᨦ", "தமிழ்", "සිංහල",
        "Ελλάς", "파란 팀", "נבחרת", "x86_64 (v2.0)", "50 % faster!", "C++ & Co.", "😀",
        "Tiếng Việt", "Łódź", "O'Neill", "—"}) {
    const absl::StatusOr<std::string> clean = CleanName(name, "name");
    ASSERT_TRUE(clean.ok()) << name << ": " << clean.status();
    EXPECT_EQ(*clean, name);
  }
  EXPECT_TRUE(CleanName(std::string(64, 'x'), "name").ok());
  EXPECT_FALSE(CleanName(std::string(65, 'x'), "name").ok());
}

TEST(CleanName, NamesTheCharacterThatNobodySees) {
  struct Row {
    std::u16string name;
    const char* code_point;
  };
  const std::vector<Row> rows = {
      {u"Team\u200bBlue", "U+200B"}, {u"Team\u2060 Blue", "U+2060"},
      {u"Team\ufe0f Blue", "U+FE0F"}, {u"Team\ufe00 Blue", "U+FE00"},
      {u"Team\xdb40\xdd00 Blue", "U+E0100"}, {u"Team\u180b Blue", "U+180B"},
      {u"Team\u3164Blue", "U+3164"}, {u"Team\uffa0Blue", "U+FFA0"},
      {u"Team\u115f Blue", "U+115F"}, {u"Team\u1160 Blue", "U+1160"},
      {u"Team\u034f Blue", "U+034F"}, {u"Team\u2800Blue", "U+2800"},
      {u"Team\u180e Blue", "U+180E"}, {u"Team\u17b4 Blue", "U+17B4"},
      {u"Team\u00ad Blue", "U+00AD"}, {u"Team\u200d Blue", "U+200D"},
      {u"Team\u202e Blue", "U+202E"}, {u"Team\u2061 Blue", "U+2061"},
      {u"Team\u1680Blue", "U+1680"}, {u"Team\xd834\xdd59 Blue", "U+1D159"},
      {u"Team\xd80d\xdc41 Blue", "U+13441"}, {u"Team\xd81b\xdfe4 Blue", "U+16FE4"},
      {u"Team\ufffc Blue", "U+FFFC"}, {u"Team\xd834\xdd73 Blue", "U+1D173"},
      {u"Team\u0085 Blue", "U+0085"}, {u"Team\x1b[2J", "U+001B"},
      {u"Team\ue000 Blue", "U+E000"}, {u"Team\u0378 Blue", "U+0378"},
      {u"Team\ufffd Blue", "U+FFFD"}, {u"\u0301Team Blue", "U+0301"},
      {u"Team \u0301Blue", "U+0301"}, {u"Tea\u0323\u0323m Blue", "U+0323"},
      {u"Team\u0307\u0307 Blue", "U+0307"}, {u"Team i\u0307", "U+0307"},
      {u"Team\xd804\xdc7fMax 1", "U+1107F"}, {u"Team Max 1\u2d7f", "U+2D7F"},
      {u"Team Max 1\u17d2", "U+17D2"}, {u"Team\u1039Blue", "U+1039"},
      {u"\u1780\u17d2", "U+17D2"}, {u"\u1780\u17d2 Blue", "U+17D2"},
      {u"a\u0300\u0316\u0301\u0317\u0302\u0318", "U+0301"}};
  for (const Row& row : rows) {
    const absl::Status status = CleanName(Utf8(row.name), "the team's name").status();
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << row.code_point;
    EXPECT_THAT(std::string(status.message()),
                ::testing::StartsWith("the team's name has " + std::string(row.code_point) + ", "));
  }
}

TEST(CleanName, SaysWhatElseIsWrong) {
  const auto problem = [](const std::string& name) {
    return std::string(CleanName(name, "name").status().message());
  };
  EXPECT_THAT(problem(""), HasSubstr("name is empty; it must be 1 to 64 bytes"));
  EXPECT_THAT(problem(" a"), HasSubstr("begins or ends with a space"));
  EXPECT_THAT(problem(Utf8(u"a\u00a0")), HasSubstr("begins or ends with a space"));
  EXPECT_THAT(problem("\xff"), HasSubstr("is not UTF-8"));
  EXPECT_THAT(problem("a\xed\xa0\x80"), HasSubstr("is not UTF-8"));
  std::string long_when_normal;  // 33 bytes of Arabic each, once normalised
  for (int i = 0; i < 3; ++i) long_when_normal += Utf8(u"\ufdfa");
  EXPECT_THAT(problem(long_when_normal), HasSubstr("is too long when it is normalised"));
}

// Twenty names that look like "Team Blue", and variants of them.
TEST(LookAlikes, NoneIsAnotherTeam) {
  const std::string team = "Team Blue";
  for (const char16_t* name :
       {u"Team\u00a0Blue", u"Team\u202fBlue", u"Team\u2003Blue", u"Team\u3000Blue", u"Team  Blue",
        u"Team \ufe0fBlue", u"Team Blue\ufe0e", u"Team Blue\u3164", u"Team\u3164Blue",
        u"Team \u115fBlue", u"Team \uffa0Blue", u"Te\u034fam Blue", u"Team Blue\u2800",
        u"Team\u2800Blue", u"Т\u0435am Blue", u"\u0422eam Blue", u"Te\u0430m Blue",
        u"Team \u0412lu\u0435", u"Team \u0392lue", u"\u0422\u0435\u0430m \u0412lu\u0435",
        u"team blue", u"TEAM BLUE", u"Team B1ue", u"Team BIue", u"Team B|ue", u"Tearn Blue",
        u"\uff34\uff45\uff41\uff4d \uff22\uff4c\uff55\uff45",
        u"\xd835\xdc13\xd835\xdc1e\xd835\xdc1a\xd835\xdc26 Blue", u"Te\u0251m Blue",
        u"Team Blu\u212f", u"Team \u212clue", u"\u24c9eam Blue", u"Team Bl\u1d1ce"}) {
    EXPECT_NE(FateBeside(team, Utf8(name)), Fate::kOther) << Utf8(name);
  }
  // All letters are from another script.
  EXPECT_EQ(FateBeside("pace", Utf8(u"\u0440\u0430\u0441\u0435")), Fate::kAlike);
  EXPECT_EQ(FateBeside("MIX", "mix"), Fate::kAlike);
  EXPECT_EQ(FateBeside("Alpha", "AIpha"), Fate::kAlike);
  EXPECT_EQ(FateBeside(Utf8(u"Caf\u00e9"), Utf8(u"Cafe\u0301")), Fate::kSame);
  EXPECT_EQ(FateBeside("Team 1", "Team l"), Fate::kAlike);
}

TEST(LookAlikes, AreNamesThatDifferInSpacesAlone) {
  for (const char16_t* name : {u"TeamMax 1", u"Team Max1", u"TeamMax1", u"T e a m Max 1", u"team max1",
                               u"Team\u2009Max\u00a01", u"Team\u3000Max1", u"TearnMax I"}) {
    EXPECT_EQ(FateBeside("TeamMax 1", Utf8(name)) == Fate::kOther, false) << Utf8(name);
    EXPECT_EQ(FateBeside("Team Max 1", Utf8(name)) == Fate::kOther, false) << Utf8(name);
  }
  EXPECT_EQ(FateBeside("Team Max 1", "Team  Max 1"), Fate::kSame);
  EXPECT_EQ(FateBeside("Team Max 1", "Team Max 2"), Fate::kOther);
}

TEST(LookAlikes, OthersAreOthers) {
  const std::vector<std::string> teams = {"Team Blue", "Team Blues", "Team Glue",  "Team 2",
                                          "Team 3",    "Läufer",     "Laufer",
                                          "Команда",   "Комета",     "チーム青",   "チーム赤",
                                          "alpha",     "alpha 2",    "alpha-2",    "beta"};
  for (const std::string& a : teams) {
    for (const std::string& b : teams) {
      EXPECT_EQ(AreAlike(a, b), a == b) << a << " and " << b;
    }
  }
}

// Letters of many scripts, including those that change most with case and normalisation. Except the
// Greek iota below a letter: in capitals it stands beside it, which looks like another name.
std::u16string Letters() {
  return u"aAbBiIlLmMnNoOrRsSvVwWxX019 -_.\u00df\u1e9e\u0130\u0131\u017f\u212a\u212b\u00e9\u0301"
         u"\u0308\u0323\ufb01\uff21\uff41\uff71\uff9e\u30a2\u3099\u03b1\u03a3\u03c3\u03c2\u0390\u0410"
         u"\u0430\u0435\u0441\u0587\u10d0\u1c90\u13a0\uab70\uac00\u1100\u1161\u11a8\u0e33\u0f73"
         u"\u2126\u00b5\u1e9b\u01c4\u01c5\u01c6\u2460\u00bd\u2163\u3300\ufdfa\u00a0";
}

rc::Gen<std::u16string> Texts() {
  return rc::gen::container<std::u16string>(rc::gen::elementOf(Letters()));
}

// The forms in which other keyboards and systems write the same name.
std::vector<std::string> FormsOf(const icu::UnicodeString& text) {
  UErrorCode error = U_ZERO_ERROR;
  std::vector<icu::UnicodeString> forms = {text};
  for (const icu::Normalizer2* normalizer :
       {icu::Normalizer2::getNFCInstance(error), icu::Normalizer2::getNFDInstance(error),
        icu::Normalizer2::getNFKCInstance(error), icu::Normalizer2::getNFKDInstance(error)}) {
    forms.push_back(normalizer->normalize(text, error));
  }
  const size_t normal = forms.size();
  for (size_t i = 0; i < normal; ++i) {
    forms.push_back(icu::UnicodeString(forms[i]).toUpper(icu::Locale::getEnglish()));
    forms.push_back(icu::UnicodeString(forms[i]).toLower(icu::Locale::getEnglish()));
    forms.push_back(icu::UnicodeString(forms[i]).foldCase());
  }
  icu::UnicodeString wide;
  for (int32_t i = 0; i < text.length(); ++i) {
    const char16_t c = text[i];
    wide += c > u' ' && c < 0x7f ? static_cast<char16_t>(c + 0xfee0) : c;
  }
  forms.push_back(wide);
  std::vector<std::string> utf8;
  for (const icu::UnicodeString& form : forms) form.toUTF8String(utf8.emplace_back());
  return utf8;
}

TEST(LookAlikes, AFormOfANameIsTheSameTeamOrRefused) {
  EXPECT_TRUE(rc::check([] {
    const std::u16string letters = *Texts();
    const icu::UnicodeString text(letters.data(), static_cast<int32_t>(letters.size()));
    std::string utf8;
    text.toUTF8String(utf8);
    const absl::StatusOr<std::string> team = CleanName(utf8, "name");
    RC_PRE(team.ok());
    for (const std::string& form : FormsOf(text)) {
      if (FateBeside(*team, form) == Fate::kOther) {
        RC_FAIL("\"" + form + "\" would be another team than \"" + *team + "\"");
      }
    }
  }));
}

TEST(CleanName, IsContentWithWhatItGave) {
  EXPECT_TRUE(rc::check([] {
    const std::string name = Utf8(*Texts());
    const absl::StatusOr<std::string> clean = CleanName(name, "name");
    RC_PRE(clean.ok());
    RC_ASSERT(*CleanName(*clean, "name") == *clean);
  }));
  EXPECT_TRUE(rc::check([](const std::string& noise) {
    const absl::StatusOr<std::string> clean = CleanName(noise, "name");
    if (clean.ok()) RC_ASSERT(*CleanName(*clean, "name") == *clean);
    RC_ASSERT(!ConfusableSkeletons(noise).empty());
  }));
}

}  // namespace
}  // namespace myograde::server
