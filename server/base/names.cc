#include "server/base/names.h"

#include <unicode/normalizer2.h>
#include <unicode/uchar.h>
#include <unicode/uscript.h>
#include <unicode/unistr.h>
#include <unicode/uspoof.h>
#include <unicode/uvernum.h>

#include <cstdlib>

#include <absl/strings/str_cat.h>
#include <absl/strings/str_format.h>

#include "protocol/base/status_macros.h"
#include "server/base/plain_text.h"

namespace myograde::server {
namespace {

// Increment whenever ConfusableSkeletons changes.
constexpr int kSkeletonRule = 2;
// With more marks than this a letter reaches into the lines above and below.
constexpr int kMaxMarks = 4;

// What a call of ICU gives. Its data is part of its library, so it fails only if memory runs out.
template <typename Call>
auto Sure(const Call& call) {
  UErrorCode error = U_ZERO_ERROR;
  auto result = call(error);
  if (U_FAILURE(error)) std::abort();
  return result;
}

// Immutable, so any thread may use it.
const USpoofChecker* Spoof() {
  static const USpoofChecker* const checker = Sure([](UErrorCode& error) {
    USpoofChecker* made = uspoof_open(&error);
    uspoof_setChecks(made, USPOOF_HIDDEN_OVERLAY, &error);
    return made;
  });
  return checker;
}

// A form of normalisation, by its getter of Normalizer2.
using Form = const icu::Normalizer2* (*)(UErrorCode&);
constexpr Form kCompatible = icu::Normalizer2::getNFKCInstance;
constexpr Form kDecomposed = icu::Normalizer2::getNFDInstance;
constexpr Form kCaseFolded = icu::Normalizer2::getNFKCCasefoldInstance;

icu::UnicodeString Normal(Form form, const icu::UnicodeString& text) {
  const icu::Normalizer2* normalizer = Sure(form);
  return Sure([&](UErrorCode& error) { return normalizer->normalize(text, error); });
}

// Decomposed first, as the iota below Greek letters becomes one beside them.
icu::UnicodeString Folded(const icu::UnicodeString& text) {
  return Normal(kCaseFolded, Normal(kDecomposed, text));
}

icu::UnicodeString Skeleton(const icu::UnicodeString& text) {
  return Sure([&](UErrorCode& error) {
    icu::UnicodeString skeleton;
    return uspoof_getSkeletonUnicodeString(Spoof(), 0, text, skeleton, &error);
  });
}

icu::UnicodeString FromUtf8(std::string_view text) {
  return icu::UnicodeString::fromUTF8({text.data(), static_cast<int32_t>(text.size())});
}

std::string ToUtf8(const icu::UnicodeString& text) {
  std::string utf8;
  text.toUTF8String(utf8);
  return utf8;
}

bool IsMark(UChar32 c) { return (U_GET_GC_MASK(c) & (U_GC_MN_MASK | U_GC_ME_MASK)) != 0; }

// Symbols and letters with a blank or placeholder glyph. Unicode has no property for them.
bool IsBlank(UChar32 c) {
  switch (c) {
    case 0x2800:   // Braille pattern blank
    case 0xfffc:   // object replacement character
    case 0x13441:  // Egyptian hieroglyph full blank
    case 0x13442:  // Egyptian hieroglyph half blank
    case 0x16fe4:  // Khitan small script filler
    case 0x1d159:  // musical symbol null notehead
      return true;
    default:
      return c != ' ' && (U_GET_GC_MASK(c) & U_GC_ZS_MASK) != 0;
  }
}

int32_t SyllabicCategory(UChar32 c) {
  return u_getIntPropertyValue(c, UCHAR_INDIC_SYLLABIC_CATEGORY);
}

UScriptCode ScriptOf(UChar32 c) {
  return Sure([&](UErrorCode& error) { return uscript_getScript(c, &error); });
}

// Whether the character at `at` is a virama that puts the next letter below the one before, and
// draws nothing where there are no such letters of its script.
bool StacksNothing(const icu::UnicodeString& text, int32_t at) {
  const UChar32 c = text.char32At(at);
  if (SyllabicCategory(c) != U_INSC_INVISIBLE_STACKER) return false;
  int32_t next = text.moveIndex32(at, 1);
  // Marks of the letter before may stand between, as normalisation orders them.
  while (next < text.length() && u_getCombiningClass(text.char32At(next)) != 0) {
    next = text.moveIndex32(next, 1);
  }
  return at == 0 || next >= text.length() || !u_isalpha(text.char32At(next)) ||
         ScriptOf(text.char32At(next)) != ScriptOf(c) ||
         ScriptOf(text.char32At(text.moveIndex32(at, -1))) != ScriptOf(c);
}

// "", or what is wrong with a character in any position.
const char* FaultOf(UChar32 c) {
  if (u_hasBinaryProperty(c, UCHAR_DEFAULT_IGNORABLE_CODE_POINT) ||
      IsUnsafe(static_cast<char32_t>(c)) ||
      (U_GET_GC_MASK(c) & (U_GC_CC_MASK | U_GC_CF_MASK | U_GC_ZL_MASK | U_GC_ZP_MASK)) != 0 ||
      SyllabicCategory(c) == U_INSC_NUMBER_JOINER || c == 0x2d7f) {  // Tifinagh consonant joiner
    return "which is not seen, or changes how others are seen; leave it out";
  }
  if ((U_GET_GC_MASK(c) & (U_GC_CN_MASK | U_GC_CO_MASK | U_GC_CS_MASK)) != 0 || c == 0xfffd) {
    return "which stands for no character; write another";
  }
  return "";
}

absl::Status Bad(std::string_view what, UChar32 c, std::string_view why) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s has U+%04X, %s", std::string(what), static_cast<uint32_t>(c), std::string(why)));
}

// Checks the name before normalisation: characters that it would silently drop or replace.
absl::Status CheckEach(const icu::UnicodeString& text, std::string_view what) {
  for (int32_t i = 0; i < text.length(); i = text.moveIndex32(i, 1)) {
    const UChar32 c = text.char32At(i);
    if (const char* fault = FaultOf(c); *fault != '\0') return Bad(what, c, fault);
  }
  return absl::OkStatus();
}

// Checks the spaces and marks of a normalised name.
absl::Status CheckShape(const icu::UnicodeString& text, std::string_view what) {
  for (int32_t i = 0; i < text.length(); i = text.moveIndex32(i, 1)) {
    const UChar32 c = text.char32At(i);
    if (IsBlank(c)) return Bad(what, c, "which looks like a space; write a space or leave it out");
    if (StacksNothing(text, i)) {
      return Bad(what, c, "which is not seen without letters of its script around it; leave it out");
    }
  }
  // Decomposed, as nobody can see whether a mark is part of a letter or follows it.
  const icu::UnicodeString apart = Normal(kDecomposed, text);
  UChar32 before = ' ';
  int marks = 0;
  for (int32_t i = 0; i < apart.length(); i = apart.moveIndex32(i, 1)) {
    const UChar32 c = apart.char32At(i);
    marks = IsMark(c) ? marks + 1 : 0;
    if (marks == 1 && before == ' ') return Bad(what, c, "a mark that has no letter before it");
    if (marks > 1 && c == before) return Bad(what, c, "a mark, twice on one letter");
    if (marks > kMaxMarks) {
      return Bad(what, c, absl::StrCat("a mark on a letter that has ", kMaxMarks, " others"));
    }
    before = c;
  }
  const int32_t faults = Sure([&](UErrorCode& error) {
    return uspoof_checkUnicodeString(Spoof(), text, nullptr, &error);
  });
  if (faults == 0) return absl::OkStatus();
  return Bad(what, 0x307, "a dot that is not seen on the letter before it; leave it out");
}

void JoinSpaces(icu::UnicodeString& text) {
  for (int32_t i = text.length() - 1; i > 0; --i) {
    if (text[i] == u' ' && text[i - 1] == u' ') text.remove(i, 1);
  }
}

void RemoveSpaces(icu::UnicodeString& text) {
  for (int32_t i = text.length() - 1; i >= 0; --i) {
    if (u_isUWhiteSpace(text[i])) text.remove(i, 1);
  }
}

}  // namespace

absl::StatusOr<std::string> CleanName(std::string_view name, std::string_view what) {
  const std::string_view rule = "; it must be 1 to 64 bytes of text without a space at its ends";
  static_assert(kMaxNameBytes == 64);
  const auto bad = [&](std::string_view why) {
    return absl::InvalidArgumentError(
        absl::StrCat(std::string(what), " ", std::string(why), std::string(rule)));
  };
  if (!IsUtf8(name)) return bad("is not UTF-8");
  if (name.size() > kMaxNameBytes) return bad("is too long");
  const icu::UnicodeString raw = FromUtf8(name);
  RETURN_IF_ERROR(CheckEach(raw, what));
  icu::UnicodeString text = Normal(kCompatible, raw);
  RETURN_IF_ERROR(CheckEach(text, what));
  JoinSpaces(text);
  std::string clean = ToUtf8(text);
  if (clean.empty()) return bad("is empty");
  if (clean.front() == ' ' || clean.back() == ' ') return bad("begins or ends with a space");
  if (clean.size() > kMaxNameBytes) return bad("is too long when it is normalised");
  RETURN_IF_ERROR(CheckShape(text, what));
  return clean;
}

std::set<std::string> ConfusableSkeletons(std::string_view name) {
  icu::UnicodeString text = Normal(kCompatible, FromUtf8(name));
  // "MIX" and "mix" are alike as they are the same in lower case, "AIpha" and "Alpha" as they are
  // drawn the same: neither order of the two steps finds both.
  icu::UnicodeString first = Skeleton(Folded(text));
  icu::UnicodeString second = Skeleton(Folded(Skeleton(text)));
  // Nobody can say for sure how many spaces a name has, or whether it has one.
  RemoveSpaces(first);
  RemoveSpaces(second);
  return {ToUtf8(first), ToUtf8(second)};
}

std::string SkeletonVersion() { return absl::StrCat(kSkeletonRule, "/", U_ICU_VERSION); }

}  // namespace myograde::server
